//! Sums of products in a normal form: what a Lagrangian is collected in.
//!
//! Σ_k c_k Π_a aⁿ over atoms a: parameters, the motion's symbols, functions of such sums. Sines and
//! cosines are multiplied out, sin a sin b = ½ [cos(a − b) − cos(a + b)] and so on, so that a
//! product holds one at most: with it every identity between them holds by itself (a Fourier sum is
//! unique), and like terms join. A sum that is divided by, or raised to a broken power, is an atom
//! of its own.

use std::collections::BTreeMap;

use crate::model::model_file::expression::{
    Function, Node, Symbol, add, call, multiply, number, power, power_whole, symbol,
};

/// Most terms of a sum: bounds what a file can ask for.
pub const MOST_TERMS: usize = 4000;
/// Highest power to which a sum, a sine or a cosine is multiplied out.
const MOST_POWER: i32 = 12;

/// A number with the order of its bits' meaning, so that sums can be compared.
#[derive(Clone, Copy, Debug)]
pub struct Real(pub f64);

impl Ord for Real {
    fn cmp(&self, other: &Self) -> core::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Real {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Real {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Real {}

/// What a product is made of.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Atom {
    /// Parameter k: of the file, a strength of an effect, or g.
    Parameter(usize),
    /// Part of the motion: a coordinate, its derivatives, an input, the drive's phase.
    Motion(Symbol),
    /// f(a).
    Call(Function, Polynomial),
    /// The angle of (x, y), from y and x.
    Atan2(Polynomial, Polynomial),
    /// A sum whose power is not multiplied out.
    Sum(Polynomial),
    /// aᵇ with a power that is no whole number.
    Power(Polynomial, Polynomial),
}

/// Atoms with their powers, each once, in their order.
pub type Product = Vec<(Atom, i32)>;

/// A sum of products.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Polynomial(BTreeMap<Product, Real>);

/// Why something has no normal form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TooLarge {
    /// More than [`MOST_TERMS`].
    Terms,
}

impl Polynomial {
    /// A number.
    pub fn number(x: f64) -> Self {
        let mut out = Self::default();
        out.put(Vec::new(), x);
        out
    }

    /// An atom.
    pub fn atom(a: Atom) -> Self {
        let mut out = Self::default();
        out.put(vec![(a, 1)], 1.0);
        out
    }

    /// A symbol of the motion.
    pub fn motion(s: Symbol) -> Self {
        Self::atom(Atom::Motion(s))
    }

    /// A sum of one product.
    pub fn product(product: Product, factor: f64) -> Self {
        let mut out = Self::default();
        out.put(product, factor);
        out
    }

    fn put(&mut self, product: Product, factor: f64) {
        use std::collections::btree_map::Entry;
        match self.0.entry(product) {
            Entry::Vacant(v) => {
                if factor != 0.0 {
                    v.insert(Real(factor));
                }
            }
            Entry::Occupied(mut o) => {
                let (before, sum) = (o.get().0, o.get().0 + factor);
                // What cancels leaves rounding only.
                if sum.abs() <= 1e-14 * before.abs() {
                    o.remove();
                } else {
                    o.insert(Real(sum));
                }
            }
        }
    }

    /// Products and their factors.
    pub fn terms(&self) -> impl Iterator<Item = (&Product, f64)> {
        self.0.iter().map(|(p, c)| (p, c.0))
    }

    /// Number of products.
    pub fn size(&self) -> usize {
        self.0.len()
    }

    /// Whether it is 0.
    pub fn is_zero(&self) -> bool {
        self.0.is_empty()
    }

    /// The number that it is, if it is one.
    pub fn as_number(&self) -> Option<f64> {
        match self.0.len() {
            0 => Some(0.0),
            1 => self.0.get(&Vec::new()).map(|x| x.0),
            _ => None,
        }
    }

    /// The sum of two.
    pub fn plus(&self, other: &Self) -> Self {
        let mut out = self.clone();
        other.terms().for_each(|(p, c)| out.put(p.clone(), c));
        out
    }

    /// A multiple.
    pub fn scaled(&self, by: f64) -> Self {
        if by == 0.0 {
            Self::default()
        } else {
            Self(self.0.iter().map(|(p, c)| (p.clone(), Real(c.0 * by))).collect())
        }
    }

    /// The difference.
    pub fn minus(&self, other: &Self) -> Self {
        self.plus(&other.scaled(-1.0))
    }

    /// The product.
    ///
    /// # Errors
    /// One too large to be written out.
    pub fn times(&self, other: &Self) -> Result<Self, TooLarge> {
        if self.size().saturating_mul(other.size()) > MOST_TERMS * 16 {
            return Err(TooLarge::Terms);
        }
        let mut out = Self::default();
        for (p, x) in self.terms() {
            for (q, y) in other.terms() {
                multiply_into(p, q, x * y, &mut out);
            }
            if out.size() > MOST_TERMS {
                return Err(TooLarge::Terms);
            }
        }
        Ok(out)
    }

    /// A whole power.
    ///
    /// # Errors
    /// One too large to be written out.
    pub fn power(&self, n: i32) -> Result<Self, TooLarge> {
        if let Some(x) = self.as_number() {
            return Ok(Self::number(x.powi(n)));
        }
        if n == 0 {
            return Ok(Self::number(1.0));
        }
        let single = self.0.len() == 1 && self.0.keys().all(|p| p.iter().all(|(a, _)| !is_trigonometric(a)));
        if single {
            let raised = |(p, c): (&Product, f64)| {
                Self::product(p.iter().map(|(a, k)| (a.clone(), k.saturating_mul(n))).collect(), c.powi(n))
            };
            return Ok(self.terms().next().map(raised).unwrap_or_default());
        }
        match n {
            1..=MOST_POWER => (1..n).try_fold(self.clone(), |p, _| p.times(self)),
            _ => {
                // The sum's own size goes in front, so that sums that differ by a factor are one
                // atom.
                let size = self.0.values().next().map_or(1.0, |x| x.0);
                Ok(Self::product(vec![(Atom::Sum(self.scaled(1.0 / size)), n)], size.powi(n)))
            }
        }
    }

    /// A function of it.
    pub fn call(f: Function, a: Self) -> Self {
        if let Some(x) = a.as_number() {
            return Self::number(f.value(x));
        }
        let first = a.0.values().next().map_or(1.0, |x| x.0);
        let odd = matches!(f, Function::Sin | Function::Tan | Function::Sign | Function::Tanh | Function::Wrap);
        let even = matches!(f, Function::Cos | Function::Abs);
        let sign = if first < 0.0 && (odd || even) { -1.0 } else { 1.0 };
        // The sign of a product does not depend on its size.
        let size = if f == Function::Sign { first.abs() } else { 1.0 };
        let argument = if sign < 0.0 || size != 1.0 { a.scaled(sign / size) } else { a };
        Self::product(vec![(Atom::Call(f, argument), 1)], if odd { sign } else { 1.0 })
    }

    /// Sums of angles as one angle, wrapped as a whole (`model_file/whole_angles.rs`), where weights
    /// are whole but for a common factor.
    pub fn of_whole_angles(&self, is_angle: &dyn Fn(usize) -> bool) -> Self {
        let is_lone = |p: &Product| matches!(p[..], [(Atom::Motion(Symbol::Coordinate(i)), 1)] if is_angle(i));
        let least = self.terms().filter(|t| is_lone(t.0)).map(|t| t.1.abs()).fold(f64::INFINITY, f64::min);
        let (mut angles, mut rest) = (Self::default(), Self::default());
        for (p, c) in self.terms() {
            if is_lone(p) { angles.put(p.clone(), c / least) } else { rest.put(p.clone(), c) }
        }
        let is_one = angles.size() > 1 && angles.terms().all(|t| t.1.fract() == 0.0);
        if is_one { Self::call(Function::Wrap, angles).scaled(least).plus(&rest) } else { self.clone() }
    }

    /// Whether some atom, also inside functions, satisfies a condition.
    pub fn any(&self, wanted: &dyn Fn(&Atom) -> bool) -> bool {
        self.0.keys().flatten().any(|(a, _)| {
            wanted(a)
                || match a {
                    Atom::Parameter(_) | Atom::Motion(_) => false,
                    Atom::Call(_, p) | Atom::Sum(p) => p.any(wanted),
                    Atom::Atan2(y, x) | Atom::Power(y, x) => y.any(wanted) || x.any(wanted),
                }
        })
    }

    /// Whether it holds a parameter.
    pub fn has_parameter(&self) -> bool {
        self.any(&|a| matches!(a, Atom::Parameter(_)))
    }

    /// Whether a parameter is a factor of one of its products.
    pub fn has_own_parameter(&self) -> bool {
        self.0.keys().flatten().any(|(a, _)| matches!(a, Atom::Parameter(_)))
    }

    /// Whether it holds a symbol of the motion that satisfies a condition.
    pub fn moves(&self, wanted: impl Fn(Symbol) -> bool) -> bool {
        self.any(&|a| matches!(a, Atom::Motion(s) if wanted(*s)))
    }

    /// Its value; `of` gives those of parameters and symbols.
    pub fn value(&self, of: &dyn Fn(&Atom) -> f64) -> f64 {
        self.terms().map(|(p, c)| p.iter().fold(c, |x, (a, n)| x * atom_value(a, of).powi(*n))).sum()
    }

    /// The same as an expression; parameters are not numbers in it.
    pub fn node(&self) -> Node {
        self.node_at(&[])
    }

    /// The same as an expression at values of the parameters; one without a value is not a number.
    pub fn node_at(&self, parameters: &[f64]) -> Node {
        let of = |p: &Self| p.node_at(parameters);
        let mut sum: Option<Node> = None;
        for (product, c) in self.terms() {
            let mut factors: Option<Node> = None;
            for (a, n) in product {
                let base = match a {
                    Atom::Parameter(k) => number(parameters.get(*k).copied().unwrap_or(f64::NAN)),
                    Atom::Motion(s) => symbol(*s),
                    Atom::Call(f, p) => call(*f, of(p)),
                    Atom::Sum(p) => of(p),
                    Atom::Power(a, b) => power(of(a), of(b)),
                    // Only quantities hold it.
                    Atom::Atan2(..) => number(f64::NAN),
                };
                let base = if *n == 1 { base } else { power_whole(base, *n) };
                factors = Some(match factors {
                    Some(f) => multiply(f, base),
                    None => base,
                });
            }
            let term = match factors {
                Some(f) if c == 1.0 => f,
                Some(f) => multiply(number(c), f),
                None => number(c),
            };
            sum = Some(match sum {
                Some(s) => add(s, term),
                None => term,
            });
        }
        sum.unwrap_or_else(|| number(0.0))
    }

    /// The symbols of the motion and the rest apart: what of the parameters each product of the
    /// motion has as its factor.
    pub fn by_motion(&self) -> BTreeMap<Product, Self> {
        let mut out: BTreeMap<Product, Self> = BTreeMap::new();
        for (p, c) in self.terms() {
            let (own, rest): (Product, Product) = p.iter().cloned().partition(|(a, _)| matches!(a, Atom::Parameter(_)));
            out.entry(rest).or_default().put(own, c);
        }
        out.retain(|_, e| !e.is_zero());
        out
    }

    /// Parameters and the rest apart: Σ (product of parameters) × (sum of the motion).
    pub fn by_parameters(&self) -> BTreeMap<Product, Self> {
        let mut out: BTreeMap<Product, Self> = BTreeMap::new();
        for (p, c) in self.terms() {
            let (own, rest): (Product, Product) = p.iter().cloned().partition(|(a, _)| matches!(a, Atom::Parameter(_)));
            out.entry(own).or_default().put(rest, c);
        }
        out.retain(|_, e| !e.is_zero());
        out
    }
}

/// Value of an atom.
fn atom_value(a: &Atom, of: &dyn Fn(&Atom) -> f64) -> f64 {
    match a {
        Atom::Parameter(_) | Atom::Motion(_) => of(a),
        Atom::Call(f, p) => f.value(p.value(of)),
        Atom::Atan2(y, x) => y.value(of).atan2(x.value(of)),
        Atom::Sum(p) => p.value(of),
        Atom::Power(a, b) => a.value(of).powf(b.value(of)),
    }
}

fn is_trigonometric(a: &Atom) -> bool {
    matches!(a, Atom::Call(Function::Sin | Function::Cos, _))
}

/// Adds factor · p · q to a sum.
fn multiply_into(p: &Product, q: &Product, factor: f64, out: &mut Polynomial) {
    let mut all = p.clone();
    let mut second: Option<&Atom> = None;
    for (a, n) in q {
        if is_trigonometric(a) && all.iter().any(|(b, _)| is_trigonometric(b)) {
            second = Some(a);
            continue;
        }
        match all.binary_search_by(|(b, _)| b.cmp(a)) {
            Ok(i) => {
                all[i].1 = all[i].1.saturating_add(*n);
                if all[i].1 == 0 {
                    all.remove(i);
                }
            }
            Err(i) => all.insert(i, (a.clone(), *n)),
        }
    }
    let first = all.iter().position(|(b, _)| is_trigonometric(b));
    let (Some(Atom::Call(g, b)), Some(i)) = (second, first) else { return out.put(all, factor) };
    let (Atom::Call(f, a), _) = all.remove(i) else { return };
    use Function::{Cos, Sin};
    // f(a) g(b) as half of two functions of a − b and a + b, with the sign of each.
    let (kind, minus, plus) = match (f, g) {
        (Sin, Sin) => (Cos, 1.0, -1.0),
        (Cos, Cos) => (Cos, 1.0, 1.0),
        (Sin, _) => (Sin, 1.0, 1.0),
        _ => (Sin, -1.0, 1.0),
    };
    for (argument, sign) in [(a.minus(b), minus), (a.plus(b), plus)] {
        for (t, c) in Polynomial::call(kind, argument).terms() {
            let mut whole = all.clone();
            for (x, n) in t {
                let at = whole.binary_search_by(|(y, _)| y.cmp(x)).unwrap_or_else(|i| i);
                whole.insert(at, (x.clone(), *n));
            }
            out.put(whole, 0.5 * sign * factor * c);
        }
    }
}

#[cfg(test)]
#[path = "polynomial_tests.rs"]
mod tests;
