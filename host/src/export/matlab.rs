//! MATLAB without toolboxes; GNU Octave runs it as it is.

use super::procedural::{self, Procedural, signed};
use super::program::Program;
use super::{Language, Notation, Printed};

/// See [`super::LANGUAGES`].
pub struct Matlab;

impl Notation for Matlab {}

impl Language for Matlab {
    fn id(&self) -> &'static str {
        "matlab"
    }

    fn about(&self) -> &'static str {
        "MATLAB without toolboxes (GNU Octave too)"
    }

    fn template(&self) -> &'static str {
        include_str!("templates/matlab.m")
    }

    fn remark(&self) -> &'static str {
        "%"
    }

    fn reserved(&self) -> &'static str {
        "break case catch classdef continue else elseif end for function global if otherwise parfor \
         persistent return spmd switch try while until do unwind_protect endif endfor endfunction \
         endwhile i j pi Inf NaN eps ans sin cos tan sqrt exp log abs sign tanh floor round max zeros \
         numel any isempty nargin fprintf sum wrap hat f inputs t x u dx held h matrix right acceleration \
         along hold_signs switches gains right_hand_side find turned released runge_kutta step weights \
         rate modes OMEGA tau feval disp error e"
    }

    fn places(&self, p: &Program<'_>) -> Vec<(&'static str, String)> {
        let mut out = procedural::places(self, p);
        let zeros = vec!["0"; p.inputs.len()].join("; ");
        out.push(("zero_column", zeros));
        out.push(("initial_column", p.initial().join("; ")));
        out.push(("rates_column", rates(&out).replace(", ", "; ")));
        out
    }
}

fn rates(places: &[(&'static str, String)]) -> String {
    places.iter().find(|p| p.0 == "rates").map_or_else(String::new, |p| p.1.clone())
}

impl Procedural for Matlab {
    fn indent(&self) -> &'static str {
        "  "
    }

    fn constant_indent(&self) -> &'static str {
        "  "
    }

    fn constant(&self, name: &str, value: &str) -> String {
        format!("{name} = {value};")
    }

    fn define(&self, name: &str, value: &str) -> String {
        format!("{name} = {value};")
    }

    fn assign(&self, target: &str, value: &str) -> String {
        format!("{target} = {value};")
    }

    fn element(&self, vector: &str, i: usize) -> String {
        format!("{vector}({})", i + 1)
    }

    fn entry(&self, matrix: &str, i: usize, j: usize) -> String {
        format!("{matrix}({}, {})", i + 1, j + 1)
    }

    fn sum(&self, target: &str, terms: &[Printed], indent: &str) -> String {
        let all: Vec<String> = terms.iter().enumerate().map(|(k, t)| signed(t, k == 0)).collect();
        format!("{target} = {};", all.join(&format!(" ...\n{indent}    ")))
    }

    fn held(&self, k: usize, _form: &str) -> String {
        format!("held({})", k + 1)
    }

    fn row_end(&self) -> &'static str {
        "; "
    }

    fn row(&self, items: &[String]) -> String {
        items.join(", ")
    }
}
