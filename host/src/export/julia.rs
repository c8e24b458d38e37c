//! Julia without packages.

use super::procedural::{self, Procedural};
use super::program::Program;
use super::{Language, Notation, Printed};

/// See [`super::LANGUAGES`].
pub struct Julia;

impl Notation for Julia {}

impl Language for Julia {
    fn id(&self) -> &'static str {
        "julia"
    }

    fn about(&self) -> &'static str {
        "Julia without packages"
    }

    fn template(&self) -> &'static str {
        include_str!("templates/julia.jl")
    }

    fn remark(&self) -> &'static str {
        "#"
    }

    fn reserved(&self) -> &'static str {
        "baremodule begin break catch const continue do else elseif end export false finally for function \
         global if import in isa let local macro module mutable outer primitive public quote return \
         struct true try type using where while abstract pi im Inf NaN sin cos tan sqrt exp log abs sign \
         tanh floor round max zeros sum copy any println join length wrap hat f inputs t x u dx held h \
         matrix right acceleration N STEP_S SECONDS EVERY X0 SWITCHES along gains hold turned released \
         runge_kutta step main OMEGA tau nothing findall eachindex Float64 string vcat isnothing isempty \
         reshape abspath Int PROGRAM_FILE"
    }

    fn places(&self, p: &Program<'_>) -> Vec<(&'static str, String)> {
        procedural::places(self, p)
    }
}

impl Procedural for Julia {
    fn constant(&self, name: &str, value: &str) -> String {
        format!("const {name} = {value}")
    }

    fn element(&self, vector: &str, i: usize) -> String {
        format!("{vector}[{}]", i + 1)
    }

    fn entry(&self, matrix: &str, i: usize, j: usize) -> String {
        format!("{matrix}[{}, {}]", i + 1, j + 1)
    }

    fn sum(&self, target: &str, terms: &[Printed], indent: &str) -> String {
        // A line that ends with an operator goes on.
        let mut out = format!("{target} =");
        for (k, t) in terms.iter().enumerate() {
            let sign = match (k == 0, t.negative) {
                (true, true) => "-",
                _ => "",
            };
            let next = terms.get(k + 1).map_or("", |n| if n.negative { " -" } else { " +" });
            out.push_str(&format!("\n{indent}    {sign}{}{next}", t.text));
        }
        out
    }

    fn held(&self, k: usize, form: &str) -> String {
        format!("isnothing(held) ? sign({form}) : held[{}]", k + 1)
    }

    fn row(&self, items: &[String]) -> String {
        items.join(" ")
    }

    fn row_end(&self) -> &'static str {
        "; "
    }
}
