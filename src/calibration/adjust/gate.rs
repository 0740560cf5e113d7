//! Corners and views that do not fit, left out with a reason.

use super::data::PoseSights;
use super::fit::Fit;
use super::normal;

/// A corner farther off than this is wrong: 1 of 270 000 right ones is, where errors are normal.
const CORNER_SIGMA: f64 = 5.0;
/// Rounds of leaving out and solving again.
const ROUNDS: usize = 10;
/// Fewest corners of a view that stays.
const MIN_CORNERS: usize = 4;

/// Solves, leaves out what does not fit, and again until nothing changes.
///
/// Poses of which nothing is left are taken out of `fit`; `whole` hears of views left out, by pose and camera.
pub(super) fn settle(fit: &mut Fit, whole: &mut dyn FnMut(usize, usize, String)) -> Result<(), String> {
    for _ in 0..3 {
        fit.rough_scales();
        fit.go()?;
    }
    for _ in 0..ROUNDS {
        fit.go_and_reweight(true)?;
        let mut changed = false;
        for at in 0..fit.sights.len() {
            changed |= judge_corners(fit, at);
            changed |= judge_views(fit, at, whole);
        }
        drop_empty(fit);
        if !changed {
            return Ok(());
        }
    }
    fit.go_and_reweight(true).map(drop)
}

fn judge_corners(fit: &mut Fit, at: usize) -> bool {
    let Fit { state, sights, weights, .. } = fit;
    let mut changed = false;
    for (camera, view) in sights[at].views.iter_mut().enumerate() {
        for sight in view {
            let error = normal::error(state, &state.poses[at], camera, sight);
            let fits = error.is_some_and(|e| e.norm() <= CORNER_SIGMA * weights.scale[camera]);
            changed |= fits != sight.used;
            sight.used = fits;
        }
    }
    changed
}

/// A view of which less than half fits does not show the board where it was.
fn judge_views(fit: &mut Fit, at: usize, whole: &mut dyn FnMut(usize, usize, String)) -> bool {
    let mut changed = false;
    for camera in 0..2 {
        let PoseSights { index, views, .. } = &mut fit.sights[at];
        let (all, used) = (views[camera].len(), views[camera].iter().filter(|s| s.used).count());
        let stays = all == 0 || (2 * used >= all && used >= MIN_CORNERS);
        if stays {
            continue;
        }
        whole(*index, camera, format!("{used} of {all} corners fit within {CORNER_SIGMA} sigma"));
        views[camera].clear();
        changed = true;
    }
    changed
}

fn drop_empty(fit: &mut Fit) {
    let keep: Vec<bool> = fit.sights.iter().map(|s| s.used() > 0).collect();
    let mut flags = keep.iter();
    fit.state.poses.retain(|_| flags.next().copied().unwrap_or(true));
    let mut flags = keep.iter();
    fit.sights.retain(|_| flags.next().copied().unwrap_or(true));
}

/// The corners of a view that were left out.
pub(super) fn left_out(fit: &Fit, at: usize, camera: usize) -> Vec<(u32, f64, f64)> {
    let pose = &fit.state.poses[at];
    let out = fit.sights[at].views[camera].iter().filter(|s| !s.used);
    let distance = |s: &super::data::Sight| {
        let px = normal::error_px(&fit.state, pose, camera, s)?.norm();
        let sigmas = normal::error(&fit.state, pose, camera, s)?.norm() / fit.weights.scale[camera];
        Some((s.id, px, CORNER_SIGMA * px / sigmas))
    };
    out.filter_map(distance).collect()
}
