//! Parameters of the nominal rig.

/// The double pendulum's parameters, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Mass of arm 1, kg.
    pub m1: f64,
    /// Joint 1 to the centroid of arm 1, m.
    pub e1: f64,
    /// Joint 1 to joint 2, m.
    pub l1: f64,
    /// Mass of arm 2, kg.
    pub m2: f64,
    /// Joint 2 to the centroid of arm 2, m.
    pub e2: f64,
    /// J_c1 + m1 e1² + m2 l1², kg m².
    pub j_o1: f64,
    /// J_c2 + m2 e2², kg m².
    pub j_o2: f64,
    /// Coulomb friction torque of joint 1, N m.
    pub tau_c1: f64,
    /// Viscous friction of joint 2, N m s.
    pub c_r2: f64,
    /// Gravity, m/s².
    pub g: f64,
}

impl Parameters {
    /// Table 3.1 and 3.2 of the dissertation: the rig as printed.
    pub const PRINTED: Self = Self {
        m1: 0.1362,
        e1: 0.0127,
        l1: 0.0635,
        m2: 0.040,
        e2: 0.0267,
        j_o1: 5.99e-4,
        j_o2: 4.033e-5,
        tau_c1: 6.03e-4,
        c_r2: 6.145e-5,
        g: 9.81,
    };

    /// H = m2 e2 l1, kg m².
    pub fn h(&self) -> f64 {
        self.m2 * self.e2 * self.l1
    }

    /// S1 = m1 e1 + m2 l1, kg m.
    pub fn s1(&self) -> f64 {
        self.m1 * self.e1 + self.m2 * self.l1
    }

    /// S2 = m2 e2, kg m.
    pub fn s2(&self) -> f64 {
        self.m2 * self.e2
    }

    /// Checks that two rigid arms can have these values.
    ///
    /// # Errors
    /// Names the parameter, its value and what is expected.
    pub fn validate(&self) -> Result<(), ParameterError> {
        for (name, value) in
            [("m1", self.m1), ("l1", self.l1), ("m2", self.m2), ("J_o1", self.j_o1), ("J_o2", self.j_o2)]
        {
            if !(value.is_finite() && value > 0.0) {
                return Err(ParameterError::new(name, value, "a value above 0"));
            }
        }
        for (name, value) in
            [("e1", self.e1), ("e2", self.e2), ("tau_c1", self.tau_c1), ("c_r2", self.c_r2), ("g", self.g)]
        {
            if !(value.is_finite() && value >= 0.0) {
                return Err(ParameterError::new(name, value, "a value of 0 or more"));
            }
        }
        let determinant = self.j_o1 * self.j_o2 - self.h() * self.h();
        // Written so that NaN fails too; the share keeps the mass matrix away from singular.
        if determinant.is_nan() || determinant <= 1e-9 * self.j_o1 * self.j_o2 {
            return Err(ParameterError::new("J_o1 J_o2", self.j_o1 * self.j_o2, "more than (m2 e2 l1)²"));
        }
        Ok(())
    }
}

/// A parameter that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} is {value}, expected {expected}")]
pub struct ParameterError {
    /// Name of the parameter.
    pub name: String,
    /// Value found.
    pub value: f64,
    /// What was expected.
    pub expected: String,
}

impl ParameterError {
    pub(crate) fn new(name: &str, value: f64, expected: &str) -> Self {
        Self { name: name.to_owned(), value, expected: expected.to_owned() }
    }
}
