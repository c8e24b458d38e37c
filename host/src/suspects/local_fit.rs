//! Least squares on a short window: a polynomial, and what may break it.
//!
//! x_j = Σ c_i P_i(u_j) + Σ β_m f_m(u_j) + e_j, the P_i orthonormal on the window (Gram and Schmidt
//! on u^i), the f_m a step ½ sign(u − c), a bend ½ abs(u − c), a change of curvature ½ (u − c)²
//! sign(u − c)/2, or single samples left free. β of a step is its height, of a bend the change of
//! velocity in units a sample, of a curvature the change of acceleration.

/// What may be added to the polynomial; places are half samples (a step at k − ½ lies between
/// samples k − 1 and k).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    Step(f64),
    Bend(f64),
    Curvature(f64),
    Sample(usize),
}

impl Shape {
    fn column(self, n: usize) -> Vec<f64> {
        let of = |f: &dyn Fn(f64) -> f64, at: f64| (0..n).map(|j| f(j as f64 - at)).collect();
        match self {
            Self::Step(at) => of(&|u| 0.5 * u.signum(), at),
            Self::Bend(at) => of(&|u| 0.5 * u.abs(), at),
            Self::Curvature(at) => of(&|u| 0.25 * u * u.abs(), at),
            Self::Sample(k) => (0..n).map(|j| f64::from(u8::from(j == k))).collect(),
        }
    }
}

/// A polynomial on n samples.
#[derive(Clone, Debug)]
pub struct Window {
    n: usize,
    polynomials: Vec<Vec<f64>>,
}

/// What a fit leaves and finds.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// Sum of the squares left.
    pub rest: f64,
    /// β of each shape.
    pub values: Vec<f64>,
    /// Standard error of the last shape's β for errors of unit variance.
    pub error: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(x: &mut [f64], by: f64, y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x -= by * y);
}

impl Window {
    /// Polynomials up to `degree` on n samples (more than the degree).
    pub fn new(n: usize, degree: usize) -> Self {
        let centre = 0.5 * (n.max(2) - 1) as f64;
        let mut polynomials: Vec<Vec<f64>> = Vec::with_capacity(degree + 1);
        for i in 0..=degree.min(n.saturating_sub(1)) {
            let mut p: Vec<f64> = (0..n).map(|j| ((j as f64 - centre) / centre).powi(i as i32)).collect();
            // Twice is enough for orthogonality to rounding.
            for _ in 0..2 {
                for q in &polynomials {
                    let by = dot(&p, q);
                    subtract(&mut p, by, q);
                }
            }
            let length = dot(&p, &p).sqrt();
            p.iter_mut().for_each(|v| *v /= length);
            polynomials.push(p);
        }
        Self { n, polynomials }
    }

    /// Samples.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Degrees of freedom beside the polynomial.
    pub fn freedom(&self) -> usize {
        self.n.saturating_sub(self.polynomials.len())
    }

    /// Takes the polynomial out of x.
    pub fn reduce(&self, x: &mut [f64]) {
        let first = x.first().copied().unwrap_or(0.0);
        x.iter_mut().for_each(|v| *v -= first);
        for p in &self.polynomials {
            let by = dot(x, p);
            subtract(x, by, p);
        }
    }

    /// A shape without what the polynomial can do.
    pub fn shape(&self, shape: Shape) -> Vec<f64> {
        let mut column = shape.column(self.n);
        for p in &self.polynomials {
            let by = dot(&column, p);
            subtract(&mut column, by, p);
        }
        column
    }
}

/// Fits shapes (without polynomial) to a reduced x.
pub fn fit(reduced: &[f64], shapes: &[&[f64]]) -> Fitted {
    let k = shapes.len();
    let mut rest = reduced.to_vec();
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(k);
    let (mut triangle, mut share) = (vec![vec![0.0; k]; k], vec![0.0; k]);
    for (m, shape) in shapes.iter().enumerate() {
        let mut q = shape.to_vec();
        let before = dot(&q, &q);
        for (l, b) in basis.iter().enumerate() {
            triangle[l][m] = dot(&q, b);
            subtract(&mut q, triangle[l][m], b);
        }
        let length = dot(&q, &q).sqrt();
        // A shape that the others can do already has no share of its own.
        if length * length <= 1e-12 * before.max(f64::MIN_POSITIVE) {
            q.iter_mut().for_each(|v| *v = 0.0);
            triangle[m][m] = 0.0;
        } else {
            q.iter_mut().for_each(|v| *v /= length);
            triangle[m][m] = length;
        }
        share[m] = dot(&rest, &q);
        subtract(&mut rest, share[m], &q);
        basis.push(q);
    }
    let mut values = vec![0.0; k];
    for m in (0..k).rev() {
        let known: f64 = (m + 1..k).map(|l| triangle[m][l] * values[l]).sum();
        values[m] = if triangle[m][m] > 0.0 { (share[m] - known) / triangle[m][m] } else { 0.0 };
    }
    let error = match k.checked_sub(1).map(|m| triangle[m][m]) {
        Some(length) if length > 0.0 => 1.0 / length,
        _ => f64::INFINITY,
    };
    Fitted { rest: dot(&rest, &rest), values, error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_found_with_their_sizes() {
        let window = Window::new(30, 5);
        let base = |j: usize| 3.0 + 0.2 * j as f64 - 0.01 * (j * j) as f64 + 1e6;
        for (shape, size) in [
            (Shape::Step(14.5), 7.0),
            (Shape::Bend(12.0), -3.0),
            (Shape::Curvature(16.0), 2.0),
            (Shape::Sample(9), 40.0),
        ] {
            let add = shape.column(30);
            let mut x: Vec<f64> = (0..30).map(|j| base(j) + size * add[j]).collect();
            window.reduce(&mut x);
            let found = fit(&x, &[&window.shape(Shape::Bend(20.5)), &window.shape(shape)]);
            assert!(found.rest < 1e-6 && (found.values[1] - size).abs() < 1e-4, "{shape:?}: {found:?}");
        }
        // The same shape twice is told by its error, not by a panic.
        let step = window.shape(Shape::Step(14.5));
        assert_eq!(fit(&[0.0; 30], &[&step, &step]).error, f64::INFINITY);
    }
}
