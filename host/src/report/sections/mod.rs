//! Sections of a report: one file each, one line in [`SECTIONS`], printed in this order.

pub mod explanation;
pub mod histories;
pub mod losses;
pub mod parameters;
pub mod phase_space;
pub mod portraits;
pub mod record;
pub mod reduction;
pub mod residuals;
pub mod spectra;
pub mod truth;
pub mod validation;
pub mod warnings;

use super::SectionKind;

/// Every section, in the order of a report.
pub static SECTIONS: &[SectionKind] = &[
    parameters::SECTION,
    residuals::SECTION,
    validation::SECTION,
    explanation::SECTION,
    reduction::SECTION,
    warnings::SECTION,
    record::SECTION,
    losses::SECTION,
    histories::SECTION,
    portraits::SECTION,
    spectra::SECTION,
    phase_space::SECTION,
    truth::SECTION,
];
