//! What acts on a system from outside: a drive whose phase is known, measured inputs.

/// What acts from outside along a record.
#[derive(Clone, Copy)]
pub struct Outside<'a> {
    /// Time at which `tau` holds, s.
    pub origin: f64,
    /// Phase of the drive at `origin`, rad.
    pub tau: f64,
    /// Its rate, rad/s; 0 for a free system.
    pub omega: f64,
    /// Measured inputs at a time, where the system has any.
    pub inputs: Option<Inputs<'a>>,
}

/// Measured inputs: how many, and their values at a time of the record (s).
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// How many.
    pub count: usize,
    /// Writes their values at a time.
    pub at: &'a (dyn Fn(f64, &mut [f64]) + Sync),
}

impl Outside<'_> {
    /// A drive of angular frequency `omega` whose phase is `tau` at time `origin`; no inputs.
    pub fn drive(origin: f64, tau: f64, omega: f64) -> Self {
        Self { origin, tau, omega, inputs: None }
    }
}
