//! A Pratt parser for expressions (V. R. Pratt, "Top down operator precedence", 1973), whose errors
//! point at a character.
//!
//! `+ − * /`, `^` or `**` (binds tighter than a sign before it and to the right), parentheses,
//! numbers, functions of one argument, `pi`, `tau`, names of coordinates with up to two primes
//! (`q'`, `q''`; also ′ ″), names of inputs.
//!
//! *Why not a crate.* Looked at: evalexpr 13 (AGPL, no derivatives), fasteval 0.2 (unkept since
//! 2020, no derivatives), meval 0.2 (the same), mathexpr 0.1 (no derivatives), exmex 0.21 (kept,
//! has derivatives; but its error is a text without a place, a prime cannot stand in a name, and
//! its tree is not public, which integration by parts needs). What is needed beyond a parser, the
//! tree, is the larger part; so the parser is here too.

use std::ops::Range;

pub use super::grammar::{Fault, Grammar, Mistake};
pub use super::names::Names;

/// Longest expression, characters: bounds the depth of every recursion over it.
pub const LONGEST: usize = 4000;
/// Deepest nesting of parentheses and signs.
const DEEPEST: usize = 60;

#[derive(Clone, Debug, PartialEq)]
enum Token {
    Number(f64),
    /// Name and primes.
    Name(String, usize),
    Operator(char),
    Open,
    Close,
    OpenList,
    CloseList,
    Comma,
    End,
}

struct Parser<'a, G> {
    text: &'a str,
    names: &'a G,
    /// Present token and its place.
    token: Token,
    at: Range<usize>,
    /// Where the next token is looked for.
    next: usize,
    depth: usize,
}

/// Parses an expression.
///
/// # Errors
/// The first mistake with its place.
pub fn parse<G: Grammar>(text: &str, names: &G) -> Result<G::Value, Mistake> {
    if text.chars().count() > LONGEST {
        return Err(Mistake {
            at: 0..0,
            found: format!("an expression of {} characters", text.chars().count()),
            expected: format!("at most {LONGEST}"),
            remedy: "Split it into several terms".to_owned(),
        });
    }
    let mut p = Parser { text, names, token: Token::End, at: 0..0, next: 0, depth: 0 };
    p.advance()?;
    if p.token == Token::End {
        return Err(p.mistake(
            "nothing",
            "an expression such as q' or sin(q)",
            "Write the expression between the quotes",
        ));
    }
    let e = p.expression(0)?;
    match &p.token {
        Token::End => Ok(e),
        Token::Close => Err(p.mistake("a \")\" without its \"(\"", "", "Remove it, or open it before")),
        Token::CloseList => Err(p.mistake("a \"]\" without its \"[\"", "", "Remove it, or open it before")),
        Token::Comma => {
            let lists = "A list stands in brackets, [right, up]";
            let remedy = if G::LISTS { lists } else { "Write decimals with a point" };
            Err(p.mistake("\",\"", "an operator, + - * / ^", remedy))
        }
        Token::Open | Token::OpenList | Token::Number(_) | Token::Name(..) => {
            let found = format!("\"{}\"", &text[p.at.clone()]);
            Err(p.mistake(&found, "an operator, + - * / ^", "A product needs its \"*\""))
        }
        Token::Operator(c) => Err(p.mistake(&format!("\"{c}\""), "an operand", "Correct the expression")),
    }
}

impl<G: Grammar> Parser<'_, G> {
    fn mistake(&self, found: &str, expected: &str, remedy: &str) -> Mistake {
        Mistake {
            at: self.at.clone(),
            found: found.to_owned(),
            expected: expected.to_owned(),
            remedy: remedy.to_owned(),
        }
    }

    /// Reads the next token.
    fn advance(&mut self) -> Result<(), Mistake> {
        let rest = &self.text[self.next..];
        let start = self.next + (rest.len() - rest.trim_start().len());
        let rest = &self.text[start..];
        let Some(c) = rest.chars().next() else {
            (self.token, self.at, self.next) = (Token::End, self.text.len()..self.text.len(), self.text.len());
            return Ok(());
        };
        let mut length = c.len_utf8();
        self.token = match c {
            '(' => Token::Open,
            ')' => Token::Close,
            '[' if G::LISTS => Token::OpenList,
            ']' if G::LISTS => Token::CloseList,
            ',' if G::ARGUMENTS => Token::Comma,
            '*' if rest.starts_with("**") => {
                length = 2;
                Token::Operator('^')
            }
            '+' | '-' | '*' | '/' | '^' => Token::Operator(c),
            '−' => Token::Operator('-'),
            '·' => Token::Operator('*'),
            '0'..='9' | '.' => {
                length = number_length(rest);
                match rest[..length].parse::<f64>() {
                    Ok(x) if x.is_finite() => Token::Number(x),
                    _ => {
                        self.at = start..start + length;
                        let found = format!("\"{}\"", &rest[..length]);
                        return Err(self.mistake(&found, "a number such as 0.5 or 2e-3", "Correct the number"));
                    }
                }
            }
            c if c.is_alphabetic() || c == '_' => {
                let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
                let (mut primes, mut after) = (0, end);
                for c in rest[end..].chars() {
                    primes += match c {
                        '\'' | '′' | '’' => 1,
                        '"' | '″' => 2,
                        _ => break,
                    };
                    after += c.len_utf8();
                }
                length = after;
                Token::Name(rest[..end].to_owned(), primes)
            }
            other => {
                self.at = start..start + length;
                let remedy = if other == ',' {
                    "Functions take one argument; write decimals with a point"
                } else if other == '=' {
                    "A term holds what multiplies its coefficient; the right-hand side is the key balance"
                } else {
                    "Remove it"
                };
                return Err(self.mistake(
                    &format!("the character \"{other}\""),
                    "numbers, names, + - * / ^ ( )",
                    remedy,
                ));
            }
        };
        self.at = start..start + length;
        self.next = start + length;
        Ok(())
    }

    /// An expression whose operators bind at least as tightly as `least`.
    fn expression(&mut self, least: u8) -> Result<G::Value, Mistake> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.mistake(
                &format!("more than {DEEPEST} levels of nesting"),
                "a simpler expression",
                "Split it into several terms",
            ));
        }
        let mut left = self.operand()?;
        while let Token::Operator(c) = self.token {
            let (binds, right) = match c {
                '+' | '-' => (1, 2),
                '*' | '/' => (3, 4),
                _ => (7, 6),
            };
            if binds < least {
                break;
            }
            let place = self.at.clone();
            self.advance()?;
            let operand = self.expression(right)?;
            left = self.names.operation(c, left, operand).map_err(|f| f.at(&place))?;
        }
        self.depth -= 1;
        Ok(left)
    }

    fn operand(&mut self) -> Result<G::Value, Mistake> {
        let token = self.token.clone();
        let place = self.at.clone();
        match token {
            Token::Number(x) => {
                self.advance()?;
                Ok(self.names.number(x))
            }
            Token::Operator('-') => {
                self.advance()?;
                let operand = self.expression(5)?;
                self.names.operation('*', self.names.number(-1.0), operand).map_err(|f| f.at(&place))
            }
            Token::Operator('+') => {
                self.advance()?;
                self.expression(5)
            }
            Token::Open => {
                self.advance()?;
                let e = self.expression(0)?;
                self.close(&place)?;
                Ok(e)
            }
            Token::OpenList => {
                self.advance()?;
                let items = self.items(&Token::CloseList, &place, "a \"[\" without its \"]\"")?;
                self.names.list(items).map_err(|f| f.at(&place))
            }
            Token::Name(name, primes) => {
                self.advance()?;
                self.name(&name, primes, place)
            }
            Token::Operator(c) => {
                Err(self.mistake(&format!("\"{c}\""), "a number, a name or \"(\" before it", "Complete the expression"))
            }
            Token::CloseList | Token::Comma => {
                let found = format!("\"{}\"", &self.text[place]);
                Err(self.mistake(&found, "a number, a name or \"(\"", "Complete the expression before it"))
            }
            Token::Close => {
                Err(self.mistake("\")\"", "a number, a name or \"(\"", "Complete the expression before it"))
            }
            Token::End => Err(self.mistake("the end", "a number, a name or \"(\"", "Complete the expression")),
        }
    }

    /// The ")" of the "(" at `open`.
    fn close(&mut self, open: &Range<usize>) -> Result<(), Mistake> {
        match self.token {
            Token::Close => self.advance(),
            Token::End => Err(Mistake {
                at: open.clone(),
                found: "a \"(\" without its \")\"".to_owned(),
                expected: String::new(),
                remedy: "Close it".to_owned(),
            }),
            _ => {
                let found = format!("\"{}\"", &self.text[self.at.clone()]);
                Err(self.mistake(
                    &found,
                    "an operator or \")\"",
                    "A product needs its \"*\"; functions take one argument",
                ))
            }
        }
    }

    /// Expressions with commas between them up to `end`, which is taken too.
    fn items(&mut self, end: &Token, open: &Range<usize>, unclosed: &str) -> Result<Vec<G::Value>, Mistake> {
        let mut items = vec![self.expression(0)?];
        while self.token == Token::Comma {
            self.advance()?;
            items.push(self.expression(0)?);
        }
        if self.token == *end {
            self.advance()?;
            return Ok(items);
        }
        Err(match self.token {
            Token::End => Fault::new(unclosed, "", "Close it").at(open),
            _ => {
                let found = format!("\"{}\"", &self.text[self.at.clone()]);
                self.mistake(&found, "an operator, \",\" or the end of the list", "A product needs its \"*\"")
            }
        })
    }

    fn name(&mut self, name: &str, primes: usize, place: Range<usize>) -> Result<G::Value, Mistake> {
        let called = self.token == Token::Open;
        if let Some(value) = self.names.name(name, primes, called).map_err(|f| f.at(&place))? {
            return Ok(value);
        }
        let open = self.at.clone();
        self.advance()?;
        if self.token == Token::Close {
            return Err(self.mistake("nothing", &format!("the argument of {name}"), "Put it between the parentheses"));
        }
        let arguments = if G::ARGUMENTS {
            self.items(&Token::Close, &open, "a \"(\" without its \")\"")?
        } else {
            let argument = self.expression(0)?;
            self.close(&open)?;
            vec![argument]
        };
        self.names.call(name, arguments).map_err(|f| f.at(&place))
    }
}

/// Length of the number at the start of a text.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| bytes[from..].iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
    let mut length = digits(0);
    if matches!(bytes.get(length), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(length + 1), Some(b'+' | b'-')));
        let exponent = digits(length + 1 + sign);
        if exponent > 0 {
            length += 1 + sign + exponent;
        }
    }
    length
}

#[cfg(test)]
mod tests {
    use super::super::expression::Symbol;
    use super::*;

    fn names() -> Names {
        Names { coordinates: vec!["q".into(), "phi2".into()], inputs: vec!["u".into()] }
    }

    fn value(text: &str) -> f64 {
        parse(text, &names()).unwrap_or_else(|m| panic!("{text}: {m:?}")).value(&|s| match s {
            Symbol::Coordinate(i) => 2.0 + i as f64,
            Symbol::Rate(i) => 5.0 + i as f64,
            Symbol::Acceleration(_) => 7.0,
            Symbol::Input(_) => 11.0,
            _ => 0.25,
        })
    }

    #[test]
    fn precedence_is_that_of_the_page() {
        for (text, expected) in [
            ("1 + 2*3^2", 19.0),
            ("-q^2", -4.0),
            ("2^-1", 0.5),
            ("2^3^2", 512.0),
            ("8/2/2", 2.0),
            ("8 - 2 - 2", 4.0),
            ("-q*-q'", 10.0),
            ("q''*cos(0) + phi2'*u", 7.0 + 66.0),
            ("q**2 − 1·3", 1.0),
            ("2e-1*tau + pi*0", 0.05),
            ("q′ + q″", 12.0),
            ("abs(-3) - sign(-0.5)", 4.0),
        ] {
            assert!((value(text) - expected).abs() < 1e-12, "{text}: {}", value(text));
        }
    }

    #[test]
    fn mistakes_point_at_their_character() {
        for (text, at, found) in [
            ("", 0..0, "nothing"),
            ("q +", 3..3, "the end"),
            ("sen(q)", 0..3, "sen"),
            ("3 q", 2..3, "q"),
            ("(q + 1", 0..1, "without its \")\""),
            ("q + 1)", 5..6, "without its \"(\""),
            ("q'''", 0..4, "order 3"),
            ("u'", 0..2, "derivative of u"),
            ("1.2.3", 0..5, "1.2.3"),
            ("q $ 2", 2..3, "$"),
            ("k*q", 0..1, "\"k\""),
            ("sin q", 0..3, "sin"),
            ("sin()", 4..5, "nothing"),
            ("q * / 2", 4..5, "/"),
            ("θ + q", 0..2, "θ"),
        ] {
            let m = parse(text, &names()).unwrap_err();
            assert_eq!(m.at, at, "{text}: {m:?}");
            assert!(m.found.contains(found) && !m.remedy.is_empty(), "{text}: {m:?}");
        }
        let deep = "(".repeat(100_000);
        assert!(parse(&deep, &names()).unwrap_err().found.contains("characters"));
        assert!(parse(&"-".repeat(3000), &names()).unwrap_err().found.contains("nesting"));
    }
}
