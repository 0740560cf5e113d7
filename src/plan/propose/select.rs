//! Which of the candidates: one after the other, then exchanged for better ones.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::candidates::Item;
use super::predict::Wanted;

/// Two stops of a tour differ by at least this much, m or rad: repeating a view averages its noise and nothing else.
const APART: [f64; 2] = [0.01, 5.0 * std::f64::consts::PI / 180.0];
/// Passes of exchanges at most; there are hardly ever more than five with a change.
const MAX_PASSES: usize = 8;
/// An exchange must gain this share, so that the search ends.
const GAIN: f64 = 1e-3;

/// Candidates of the same kind, of which a number is wanted.
pub(super) struct Pool {
    pub(super) items: Vec<Item>,
    pub(super) wanted: usize,
    /// Draws that they were found among.
    pub(super) drawn: usize,
}

/// A place in the tour: the pool and the candidate in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Choice {
    pub(super) pool: usize,
    pub(super) item: usize,
}

/// Chooses from pools.
pub(super) struct Search<'a> {
    pub(super) pools: &'a [Pool],
    pub(super) wanted: &'a Wanted,
    /// Corners that each camera may miss, in boards.
    pub(super) may_miss: f64,
}

impl Search<'_> {
    /// The best choices found; `step` hears of steps done and all steps. `None` where a pool is too small.
    pub(super) fn run(&self, size: usize, step: &(dyn Fn(usize, usize) + Sync)) -> Option<Vec<Choice>> {
        let slots: usize = self.pools.iter().map(|p| p.wanted).sum();
        let all = slots * (1 + MAX_PASSES);
        let mut chosen = Vec::new();
        let mut sum = DMatrix::identity(size, size);
        for (pool, Pool { wanted, .. }) in self.pools.iter().enumerate() {
            for _ in 0..*wanted {
                let (item, _) = self.best(pool, &sum, &chosen)?;
                chosen.push(Choice { pool, item });
                sum += &self.item(chosen.last()?).information;
                step(chosen.len(), all);
            }
        }
        for pass in 1..=MAX_PASSES {
            let mut changed = false;
            for slot in 0..chosen.len() {
                changed |= self.exchange(slot, &mut sum, &mut chosen);
                step(pass * slots + slot, all);
            }
            if !changed {
                break;
            }
        }
        step(all, all);
        Some(chosen)
    }

    pub(super) fn item(&self, choice: &Choice) -> &Item {
        &self.pools[choice.pool].items[choice.item]
    }

    /// Puts the best candidate into a slot, if that gains something.
    fn exchange(&self, slot: usize, sum: &mut DMatrix<f64>, chosen: &mut [Choice]) -> bool {
        let before = chosen[slot];
        let now_m2 = self.wanted.mean_square_m2(sum);
        let without = &*sum - &self.item(&before).information;
        let others: Vec<_> = chosen.iter().enumerate().filter(|(i, _)| *i != slot).map(|(_, c)| *c).collect();
        let Some((item, best_m2)) = self.best(before.pool, &without, &others) else { return false };
        let gains = best_m2 < (1.0 - GAIN) * now_m2;
        if gains {
            chosen[slot] = Choice { item, ..before };
            // Summed anew: what is taken away and added again leaves rounding behind.
            let size = sum.nrows();
            let add = |sum, choice: &Choice| sum + &self.item(choice).information;
            *sum = chosen.iter().fold(DMatrix::identity(size, size), add);
        }
        gains
    }

    /// The candidate of a pool that leaves the smallest error; of equals the first.
    fn best(&self, pool: usize, sum: &DMatrix<f64>, others: &[Choice]) -> Option<(usize, f64)> {
        let cameras = self.pools[pool].items.first()?.missed.len();
        let missed: Vec<f64> = (0..cameras).map(|c| others.iter().map(|o| self.item(o).missed[c]).sum()).collect();
        let items = &self.pools[pool].items;
        let fits = |(i, item): &(usize, &Item)| {
            let seen = item.missed.iter().zip(&missed).all(|(m, before)| m + before <= self.may_miss);
            let differs = |o: &Choice| {
                let (a, b) = (&item.first.base_from_tcp, &self.item(o).first.base_from_tcp);
                a.distance_to_m(b) >= APART[0] || a.angle_to_rad(b) >= APART[1]
            };
            seen && !others.contains(&Choice { pool, item: *i }) && others.iter().all(differs)
        };
        let judged: Vec<(usize, f64)> = items
            .par_iter()
            .enumerate()
            .filter(|(i, item)| fits(&(*i, *item)))
            .map(|(i, item)| (i, self.wanted.mean_square_m2(&(sum + &item.information))))
            .collect();
        judged.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))
    }
}
