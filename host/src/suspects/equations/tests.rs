//! Tests of the whole examination on simulated records.
