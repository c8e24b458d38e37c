//! Numbers, names and symbols for people, as every command, message and report writes them.
//!
//! | file | what |
//! |---|---|
//! | [`close`] | the name that was meant |
//! | [`format`](mod@format) | digits that the uncertainty warrants, SI units, powers of ten |
//! | [`limits`] | limits of numbers that are asked for, as they are told and taken |
//! | [`names`] | plain names of effects and parameters |
//! | [`symbols`] | Greek letters, subscripts, derivatives: plain, HTML, SVG, MathML |
//! | [`toml_words`] | what the reader of TOML met |

pub mod close;
pub mod format;
pub mod limits;
pub mod names;
pub mod symbols;
pub mod toml_words;
