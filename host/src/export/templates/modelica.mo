{{about}}
//
// The equations as they were identified; the tool solves them for the accelerations. Simulate it as it is for an example.
{{#events}}
// Dry friction: sign(v) is 0 at v = 0 only. Where joints stick, tools creep or stop; friction elements of the standard library do not.
{{/events}}
model {{name}} {{title}}
{{#wrap}}
  function wrap "Angle in [-pi, pi), rad"
    input Real x;
    output Real y;
  algorithm
    y := x - 6.283185307179586*floor(x/6.283185307179586 + 0.5);
  end wrap;
{{/wrap}}
{{#hat}}
  function hat "max(0, 1 - |d|/width), d at its shortest around a period (0: none)"
    input Real d;
    input Real width;
    input Real period;
    output Real y;
  algorithm
    y := max(0.0, 1.0 - abs(if period > 0.0 then d - period*floor(d/period + 0.5) else d)/width);
  end hat;
{{/hat}}
{{parameters}}
{{variables}}
equation
{{equations}}
  annotation(experiment(StopTime = 1.0, Tolerance = 1e-10));
end {{name}};
