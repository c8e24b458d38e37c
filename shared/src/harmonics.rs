//! harmonics
