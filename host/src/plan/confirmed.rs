//! What a proposed record would tell, by records as long as itself: how far windows can be followed
//! and how much rare motion comes in changes with the length, so that standard errors from shorter
//! ones are a first guess only.

use rayon::prelude::*;

use super::Proposal;
use super::task::Task;
use crate::explain::engine::expected::Expected;

/// Records of the proposed length.
pub const DRAWS: usize = 4;
/// Lengths that are tried, and the change of the length that is too small to try again.
const ROUNDS: usize = 3;
const ENOUGH: f64 = 0.3;

impl Task<'_> {
    /// A proposal by records of its own length, which changes until it reaches what was asked; as
    /// it is for a system that is let go, whose time is that of several releases.
    pub fn confirmed(&self, proposal: &Proposal, tick: &(dyn Fn() + Sync)) -> Proposal {
        let mut out = proposal.clone();
        if self.rig.drive.is_none() {
            return out;
        }
        for round in 0..ROUNDS {
            let looked = out.seconds;
            let draw = |k: usize| {
                let found = self.look(&out.setting, k, looked);
                tick();
                found
            };
            let all: Vec<Expected> =
                (0..DRAWS).into_par_iter().map(draw).collect::<Vec<_>>().into_iter().flatten().collect();
            if all.is_empty() {
                return out;
            }
            let found = self.proposal(&out.setting, &all, looked, None);
            let settled = (found.seconds / looked).ln().abs() < ENOUGH || round + 1 == ROUNDS;
            out = self.proposal(&out.setting, &all, looked, settled.then_some(found.seconds.max(looked)));
            if settled {
                break;
            }
        }
        out
    }
}
