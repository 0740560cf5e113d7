//! From matched edges to event windows, and what is odd about them.

use super::edges::Edges;
use super::{ExposureTime, SyncSettings, Window};

/// A window longer than this many frame periods lacks the edge that ends it.
pub(super) const PERIODS_MAX: f64 = 1.5;
/// The next edge cannot come before this part of the exposure is over.
pub(super) const EXPOSURE_PART_MIN: f64 = 0.9;
/// At most this many poses are named in a note.
const POSES_NAMED_MAX: usize = 8;

/// The window of each exposure; `pairs` holds for each the index of its rising edge.
pub(super) fn windows(
    edges: &Edges,
    pairs: &[Option<usize>],
    exposures: &[ExposureTime],
    settings: &SyncSettings,
) -> (Vec<Option<Window>>, Vec<String>) {
    let windows: Vec<Option<Window>> = pairs.iter().map(|pair| Some(window(edges, (*pair)?, settings))).collect();
    let poses = |wanted: &dyn Fn(usize) -> bool| -> Vec<usize> {
        (0..exposures.len()).filter(|&i| wanted(i)).map(|i| exposures[i].pose).collect()
    };
    let missing = poses(&|i| windows[i].is_none());
    let assumed = poses(&|i| !exposures[i].closing && windows[i].is_some_and(|window| window.assumed_end));
    let early = poses(&|i| pairs[i].is_some_and(|edge| has_early_edge(edges, edge, settings)));
    let notes = [
        note(&missing, "have no trigger edge and so no event window"),
        note(&assumed, "lack the edge that ends the window; it ends one frame period after its start"),
        note(&early, "have an extra rising edge while still exposing; it was passed over"),
    ];
    let doubled = (edges.doubled > 0).then(|| format!("{} doubled trigger edges were dropped", edges.doubled));
    (windows, notes.into_iter().flatten().chain(doubled).collect())
}

fn window(edges: &Edges, edge: usize, settings: &SyncSettings) -> Window {
    let start_us = edges.rising[edge].t_us;
    let period_us = settings.frame_period_s * 1e6;
    let next = edges.rising[edge + 1..].iter().map(|edge| edge.t_us).find(|&t_us| !is_early(start_us, t_us, settings));
    match next {
        Some(end_us) if (end_us.saturating_sub(start_us) as f64) <= PERIODS_MAX * period_us => {
            Window { start_us, end_us, assumed_end: false }
        }
        _ => Window { start_us, end_us: start_us.saturating_add(period_us.round() as i64), assumed_end: true },
    }
}

fn has_early_edge(edges: &Edges, edge: usize, settings: &SyncSettings) -> bool {
    edges.rising.get(edge + 1).is_some_and(|next| is_early(edges.rising[edge].t_us, next.t_us, settings))
}

fn is_early(start_us: i64, t_us: i64, settings: &SyncSettings) -> bool {
    (t_us.saturating_sub(start_us) as f64) < EXPOSURE_PART_MIN * settings.exposure_s * 1e6
}

fn note(poses: &[usize], what: &str) -> Option<String> {
    let mut named = poses.to_vec();
    named.dedup();
    let list: Vec<String> = named.iter().take(POSES_NAMED_MAX).map(usize::to_string).collect();
    let more = if named.len() > POSES_NAMED_MAX { ", ..." } else { "" };
    (!poses.is_empty()).then(|| format!("{} exposures {what} (poses {}{more})", poses.len(), list.join(", ")))
}
