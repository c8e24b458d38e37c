//! Effects put into the simulation of a model file: `ID@COORDINATE=VALUE[,name=value]`.
//!
//! The value is the strength in the unit that `whirl explain` tells, the parameters those that `whirl explain` tells: `v_s` (Stribeck friction), `G`
//! (load-dependent friction), `n` and `psi` (cogging, A sin(n x + ψ)).

use super::candidates::{EFFECTS, candidate};
use super::round::column_name;
use crate::effects::written::balance_scale;
use crate::error::{BadInput, Result};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::Node;

/// Terms on the left-hand sides, as `EquationsOfMotion::with_columns` takes them, and their coefficients.
#[derive(Clone, Debug, Default)]
pub struct Terms {
    /// Equation, coefficient's name, expression in seconds.
    pub terms: Vec<(usize, String, Node)>,
    /// Coefficients, in the same order.
    pub strengths: Vec<f64>,
}

/// Reads effects for a model whose primes are derivatives by the phase of a drive of angular frequency `omega`, where they are.
///
/// # Errors
/// Names the effect, what is wrong in it and what could stand there.
pub fn terms(model: &ModelFile, omega: f64, texts: &[String]) -> Result<Terms> {
    let mut out = Terms::default();
    for text in texts {
        let bad = |found: String, expected: String| {
            BadInput::new(found, expected).at(format!("--effect {text}")).remedy("See docs/model-file.md, Explanation")
        };
        let form = || bad(format!("\"{text}\""), "ID@COORDINATE=VALUE[,name=value]".to_owned());
        let (name, rest) = text.split_once('=').ok_or_else(form)?;
        let (id, at) = name.split_once('@').ok_or_else(form)?;
        let mut parts = rest.split(',');
        let number = |t: &str| {
            t.trim()
                .parse::<f64>()
                .ok()
                .filter(|x| x.is_finite())
                .ok_or_else(|| bad(format!("\"{t}\""), "a finite number".to_owned()))
        };
        let value = number(parts.next().unwrap_or_default())?;
        let Some(effect) = EFFECTS.iter().find(|e| e.id == id) else {
            let ids: Vec<&str> = EFFECTS.iter().map(|e| e.id).collect();
            return Err(bad(format!("\"{id}\""), format!("one of {}", ids.join(", "))));
        };
        let (mut shape, mut psi) = (None, 0.0);
        for part in parts {
            let (key, x) = part.split_once('=').ok_or_else(form)?;
            match key.trim() {
                "psi" if effect.phase() => psi = number(x)?,
                k if Some(k) == effect.shape() => shape = Some(number(x)?),
                k => {
                    let known: Vec<&str> = effect.shape().into_iter().chain(effect.phase().then_some("psi")).collect();
                    let known = if known.is_empty() { "no parameter".to_owned() } else { known.join(", ") };
                    return Err(bad(format!("a parameter \"{k}\""), known));
                }
            }
        }
        match effect.shape() {
            Some(name) if shape.is_none() => {
                return Err(bad(format!("no {name}"), format!("{id}@{at}=VALUE,{name}=…")));
            }
            Some(name) if shape.is_some_and(|s| s <= 0.0) => {
                return Err(bad(format!("{name} = {}", shape.unwrap_or(0.0)), "a value above 0".to_owned()));
            }
            _ => {}
        }
        let found = candidate(model, id, at, shape, &vec![1.0; model.coordinates.len()]).ok_or_else(|| {
            let names: Vec<&str> = model.coordinates.iter().map(|c| c.name.as_str()).collect();
            let where_to = if effect.phase() || effect.is_circular() { "an angle (S1) among " } else { "one of " };
            bad(format!("\"{at}\""), format!("{where_to}{}", names.join(", ")))
        })?;
        // In the unit that an explanation tells.
        let value = value / balance_scale(model, omega, found.equation);
        let strengths = if found.columns.len() == 2 { vec![value * psi.cos(), value * psi.sin()] } else { vec![value] };
        for (k, (of, s)) in found.columns.iter().zip(strengths).enumerate() {
            let name = column_name(&found, k);
            if out.terms.iter().any(|t| t.1 == name) {
                return Err(bad(format!("{id}@{at} a second time"), "each effect once".to_owned()));
            }
            out.terms.push((found.equation, name, of.clone()));
            out.strengths.push(s);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_become_terms_and_mistakes_are_told() {
        let text = "name = \"m\"\ncoordinates = [{ name = \"q\", space = \"S1\" }, { name = \"x\", space = \"R\" }]\n\
            [[equation]]\nbalance = \"-q''\"\nterms = { k = \"sin(q)\" }\n\
            [[equation]]\nbalance = \"-x''\"\nterms = { h = \"x\" }\n";
        let model = ModelFile::parse(text, std::path::Path::new("m.toml")).unwrap();
        let of = |t: &str| terms(&model, 1.0, &[t.to_owned()]);
        let found = of("stribeck-friction@x=0.3,v_s=0.8").unwrap();
        assert_eq!((found.terms[0].0, found.strengths.as_slice()), (1, &[0.3][..]));
        let found = of("cogging@q=2,n=5,psi=0.5").unwrap();
        assert!((found.strengths[1] - 2.0 * 0.5_f64.sin()).abs() < 1e-15 && found.terms.len() == 2);
        for (wrong, told) in [
            ("coulomb-friction", "ID@COORDINATE"),
            ("rust@q=1", "rust"),
            ("coulomb-friction@joint1=1", "q, x"),
            ("cogging@x=1,n=3", "an angle"),
            ("coulomb-friction@q=a", "finite number"),
            ("coulomb-friction@q=1,v_s=2", "no parameter"),
            ("stribeck-friction@q=1", "no v_s"),
            ("stribeck-friction@q=1,v_s=-1", "above 0"),
        ] {
            let error = of(wrong).unwrap_err().to_string();
            assert!(error.contains(told), "{wrong}: {error}");
        }
        let twice = vec!["coulomb-friction@q=1".to_owned(), "coulomb-friction@q=2".to_owned()];
        assert!(terms(&model, 1.0, &twice).unwrap_err().to_string().contains("second time"));
    }
}
