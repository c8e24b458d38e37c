//! Reading `ID@PLACE=VALUE[,name=value]…`.

use core::fmt;

use super::{EffectInfo, LIST, Place};

/// One effect with its values.
#[derive(Clone, Debug)]
pub struct Effect {
    /// Its row in [`LIST`].
    pub info: &'static EffectInfo,
    /// Where it acts.
    pub place: Place,
    /// Its value, in `info.unit`.
    pub value: f64,
    /// Its secondary parameters, in the order of `info.parameters`, defaults filled in.
    pub parameters: Vec<(&'static str, f64)>,
}

/// A text that is not an effect: what was found where, and what is allowed there.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}")]
pub struct EffectError {
    /// The part of the text at fault.
    pub place: String,
    /// What was found there.
    pub found: String,
    /// What is allowed.
    pub expected: String,
}

impl EffectError {
    pub(crate) fn new(place: &str, found: &str, expected: &str) -> Self {
        Self { place: place.to_owned(), found: found.to_owned(), expected: expected.to_owned() }
    }
}

fn join<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    names.into_iter().collect::<Vec<_>>().join(", ")
}

fn quoted(text: &str) -> String {
    if text.is_empty() { "nothing".to_owned() } else { format!("\"{text}\"") }
}

impl Effect {
    /// Reads one effect.
    ///
    /// # Errors
    /// An unknown id, a place where the effect does not act, a value that is no number or out of
    /// range, a parameter that the effect does not have or that is given twice: each with what is
    /// allowed.
    pub fn parse(text: &str) -> Result<Self, EffectError> {
        let form = "ID@PLACE=VALUE[,name=value], such as quadratic-drag@arm2=2e-6";
        let whole = |expected: &str| EffectError::new("effect", &quoted(text), expected);
        let (head, values) = text.split_once('=').ok_or_else(|| whole(form))?;
        let (id, place) = head.split_once('@').ok_or_else(|| whole(form))?;
        let (id, place) = (id.trim(), place.trim());
        let info = LIST.iter().find(|info| info.id == id).ok_or_else(|| {
            EffectError::new("effect id", &quoted(id), &format!("one of {}", join(LIST.iter().map(|info| info.id))))
        })?;
        let place = info.places.iter().copied().find(|p| p.name() == place).ok_or_else(|| {
            let places = join(info.places.iter().map(|p| p.name()));
            EffectError::new(&format!("place of {id}"), &quoted(place), &format!("one of {places}"))
        })?;
        let mut parts = values.split(',');
        let number = |name: &str, text: &str, range: &super::Range, unit: &str| {
            let wanted = format!("{} {unit}", range.describe());
            let value: f64 =
                text.trim().parse().map_err(|_| EffectError::new(name, &quoted(text.trim()), wanted.trim_end()))?;
            if !range.contains(value) {
                return Err(EffectError::new(name, &value.to_string(), wanted.trim_end()));
            }
            Ok(value)
        };
        let value = number(&format!("value of {id}"), parts.next().unwrap_or_default(), &info.range, info.unit)?;
        let mut parameters: Vec<(&'static str, f64)> = info.parameters.iter().map(|p| (p.name, p.default)).collect();
        let mut given = vec![false; parameters.len()];
        for part in parts {
            let allowed = if info.parameters.is_empty() {
                "no parameter beyond the value".to_owned()
            } else {
                format!("name=value with the name one of {}", join(info.parameters.iter().map(|p| p.name)))
            };
            let error = || EffectError::new(&format!("parameter of {id}"), &quoted(part), &allowed);
            let (name, text) = part.split_once('=').ok_or_else(error)?;
            let index = info.parameters.iter().position(|p| p.name == name.trim()).ok_or_else(error)?;
            let known = &info.parameters[index];
            if given[index] {
                return Err(EffectError::new(&format!("{} of {id}", known.name), "a second value", "one"));
            }
            given[index] = true;
            parameters[index].1 = number(&format!("{} of {id}", known.name), text, &known.range, known.unit)?;
        }
        Ok(Self { info, place, value, parameters })
    }
}

/// The text that [`Effect::parse`] reads, all parameters written out.
impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{}={:e}", self.info.id, self.place.name(), self.value)?;
        for (name, value) in &self.parameters {
            write!(f, ",{name}={value}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_value_and_parameters_and_writes_them_back() {
        let effect = Effect::parse("quadratic-drag@arm2=2e-6").unwrap();
        assert_eq!((effect.info.id, effect.place, effect.value), ("quadratic-drag", Place::Arm2, 2e-6));
        let effect = Effect::parse("cogging@joint1=1e-4,psi=0.3,n=7").unwrap();
        assert_eq!(effect.parameters, [("n", 7.0), ("psi", 0.3)]);
        assert_eq!(effect.to_string(), "cogging@joint1=1e-4,n=7,psi=0.3");
        for info in LIST {
            for place in info.places {
                let value = if info.range.contains(1e-3) { 1e-3 } else { info.range.greatest };
                let text = format!("{}@{}={value}", info.id, place.name());
                let effect = Effect::parse(&text).unwrap();
                let again = Effect::parse(&effect.to_string()).unwrap();
                assert_eq!((again.value, &again.parameters), (effect.value, &effect.parameters), "{text}");
                assert!(super::super::combine(&[effect]).is_ok());
            }
        }
    }

    #[test]
    fn errors_name_the_part_and_what_is_allowed() {
        let told = |text: &str| Effect::parse(text).unwrap_err().to_string();
        assert!(told("quadratic-drag").contains("ID@PLACE=VALUE"));
        assert!(told("").contains("nothing"));
        let unknown = told("quadratic-drga@arm2=1");
        assert!(unknown.contains("\"quadratic-drga\"") && unknown.contains("quadratic-drag,"), "{unknown}");
        let place = told("quadratic-drag@joint2=1");
        assert!(place.contains("\"joint2\"") && place.contains("arm1, arm2"), "{place}");
        let value = told("quadratic-drag@arm2=two");
        assert!(value.contains("\"two\"") && value.contains("a number from 0"), "{value}");
        assert!(told("quadratic-drag@arm2=-1").contains("-1"));
        assert!(told("quadratic-drag@arm2=NaN").contains("NaN"));
        assert!(told("quadratic-drag@arm2=inf").contains("inf"));
        assert!(told("quadratic-drag@arm2=1,n=2").contains("no parameter beyond"));
        assert!(told("cogging@joint1=1e-4,m=2").contains("n, psi"));
        assert!(told("cogging@joint1=1e-4,n=2.5").contains("whole number"));
        assert!(told("cogging@joint1=1e-4,n=61").contains("61"));
        assert!(told("cogging@joint1=1e-4,n=2,n=3").contains("second"));
        assert!(told("stribeck-friction@joint1=1e-4,v_s=0").contains("above 0"));
        assert!(told("channel-delay@encoder1=0.001").contains("encoder2"));
        assert!(told("relaxation@arm1=1e-3").contains("joint1, joint2"));
        assert!(told("relaxation@joint1=-1e-3").contains("a number from 0"));
        assert!(told("relaxation@joint1=1e-3,T_r=0").contains("T_r of relaxation"));
        assert!(told("hysteresis@joint2=1e-3,d=0.1").contains("b, c"));
        assert!(told("hysteresis@joint2=1e-3,c=1.1").contains("from -1 to 1"));
        assert!(told("play@joint1=1e-3,b=-0.1").contains("b of play"));
        assert!(told("lugre-friction@joint1=1e-2,s0=1").contains("s1, d, v_s, r"));
        assert!(told("lugre-friction@joint1=1e-2,d=1e-6").contains("0.0001"));
        assert!(told("tone@drive=1e-3").contains("joint1, joint2"));
        assert!(told("tone@joint1=1e-3,f=-1").contains("Hz"));
    }

    #[test]
    fn no_text_panics() {
        use proptest::prelude::*;
        proptest!(ProptestConfig::with_cases(2000), |(text in "[a-z@=,.0-9eE+-]{0,40}|\\PC{0,20}")| {
            let _ = Effect::parse(&text);
        });
    }

    #[test]
    fn effects_that_exclude_each_other_are_refused() {
        let parse = |text| Effect::parse(text).unwrap();
        let both = [parse("horizontal-motion@drive=1e-3"), parse("vertical-motion@drive=1e-3")];
        assert!(super::super::combine(&both).is_err());
        let many = vec![parse("zero-offset@encoder1=0.1"); 33];
        assert!(super::super::combine(&many).is_err());
        let harmonics = vec![parse("drive-harmonic-2@drive=0.1"); 8];
        assert!(super::super::combine(&harmonics).is_err());
        let mut memories =
            vec![parse("play@joint2=1e-3"), parse("relaxation@joint2=1e-3"), parse("relaxation@joint1=1e-3")];
        memories.extend(vec![parse("dahl-friction@joint2=1e-3"); 2]);
        assert!(super::super::combine(&memories).is_ok());
        memories.push(parse("hysteresis@joint2=1e-3"));
        let error = super::super::combine(&memories).unwrap_err().to_string();
        assert_eq!(error, "effects with a memory: found 5 of them, expected at most 4 in a joint");
    }
}
