//! Sections of a report: one file each, one line in [`SECTIONS`], printed in this order.

pub mod answer;
pub mod explanation;
pub mod histories;
pub mod losses;
pub mod next;
pub mod parameters;
pub mod phase_space;
pub mod portraits;
pub mod provenance;
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
    answer::SECTION,
    warnings::SECTION,
    explanation::SECTION,
    record::SECTION,
    losses::SECTION,
    histories::SECTION,
    portraits::SECTION,
    spectra::SECTION,
    phase_space::SECTION,
    parameters::SECTION,
    residuals::SECTION,
    validation::SECTION,
    reduction::SECTION,
    truth::SECTION,
    next::SECTION,
    provenance::SECTION,
];
