"""whirl: from encoder counts to a trusted equation of motion, and to the physical effect that the model is missing.

    r = whirl.read("run.csv")
    whirl.init(r, output="rig.toml")
    m = whirl.identify(r, rig="rig.toml")
    e = whirl.explain(r, rig="rig.toml")
    e.report("explanation.html")

The functions are the program's commands, by the same way: the same options, results, warnings and messages.
"""

from ._commands import explain, identify, init, inspect, reduce, simulate, validate
from ._record import Record, read
from ._results import (Answer, Draft, Effect, Explanation, Identification, Inspection, Parameter, Parameters, Reduction,
                       Validation)
from ._warn import WhirlWarning
from ._whirl import Error, __version__

__all__ = ["Answer", "Draft", "Effect", "Error", "Explanation", "Identification", "Inspection", "Parameter", "Parameters", "Record",
           "Reduction", "Validation", "WhirlWarning", "__version__", "explain", "identify", "init", "inspect", "read", "reduce",
           "simulate", "validate"]
