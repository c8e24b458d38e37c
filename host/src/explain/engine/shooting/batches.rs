//! Candidates in batches: Gram matrices over all columns of a system of many joints would fill the memory, and no two candidates of different batches are needed at once.

use super::super::candidates::Candidate;
use super::super::setting::Setting;
use super::super::state::State;
use super::blocks::Blocks;
use super::evidence;
use crate::explain::ranking::Fit;

/// Most columns of candidates in a batch, and the entries of all its Gram matrices: 400 MB.
const MOST_COLUMNS: usize = 700;
const MOST_ENTRIES: f64 = 5e7;
/// Horizons that windows are predicted over.
const HORIZONS: f64 = 2.0;

/// Candidates beside one another.
struct Batch {
    /// Its columns among those of all candidates, behind the own ones.
    first: usize,
    end: usize,
    blocks: Blocks,
}

/// All candidates.
pub struct Batches {
    own: usize,
    all: Vec<Batch>,
}

impl Batches {
    /// Columns of the model's own, of what was chosen, and of some candidates; none where nothing can be followed.
    pub fn new(setting: &Setting<'_>, state: &State, candidates: &[&Candidate]) -> Option<Self> {
        let own = state.own_columns();
        let windows = state.followed.as_ref().map_or(1, |f| f.windows(setting).0).max(1) as f64;
        let most = ((MOST_ENTRIES / (HORIZONS * windows)).sqrt() as usize).clamp(2 * own, MOST_COLUMNS.max(2 * own));
        let mut all = Vec::new();
        let (mut first, mut rest) = (own, candidates);
        loop {
            let (mut count, mut columns) = (0, 0);
            while let Some(c) = rest.get(count) {
                if count > 0 && columns + c.strengths() > most {
                    break;
                }
                columns += c.strengths();
                count += 1;
            }
            let (batch, others) = rest.split_at(count);
            all.push(Batch { first, end: first + columns, blocks: evidence(setting, state, batch, &[])? });
            (first, rest) = (first + columns, others);
            if rest.is_empty() {
                return Some(Self { own, all });
            }
        }
    }

    /// The first batch, which has the model's own columns as every one.
    pub fn first(&self) -> &Blocks {
        &self.all[0].blocks
    }

    /// Fits some columns; none where they are singular or of two batches.
    pub fn fit(&self, columns: &[usize]) -> Option<Fit> {
        let further = || columns.iter().filter(|c| **c >= self.own);
        let holds = |b: &&Batch| further().all(|c| (b.first..b.end).contains(c));
        let batch = self.all.iter().find(holds)?;
        let place = |c: &usize| if *c < self.own { *c } else { self.own + c - batch.first };
        batch.blocks.fit(&columns.iter().map(place).collect::<Vec<_>>())
    }
}
