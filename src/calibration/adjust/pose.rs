//! The board's pose from its corners alone, with everything else as it is.

use nalgebra::{Isometry3, Matrix6, Vector6};

use super::data::{PoseSights, Sight};
use super::normal::{self, PoseNormal, Weights, pose_normal};
use super::state::{Active, State, moved};

const STEPS: usize = 20;

/// The pose that fits the corners that `counts` names, of both cameras, from the start that `state` has.
///
/// Only `state.poses[0]` is used; `None` where they do not determine it.
pub(super) fn fit(
    state: &mut State,
    sights: &PoseSights,
    weights: &Weights,
    counts: &dyn Fn(&Sight) -> bool,
) -> Option<Isometry3<f64>> {
    let mut chosen = PoseSights { tied: false, ..sights.clone() };
    chosen.views.iter_mut().flatten().for_each(|s| s.used = s.used && counts(s));
    let weights = Weights { scale: weights.scale, ties: None };
    let (mut normal, nothing) = (PoseNormal::zeros(), Active::nothing());
    let mut cost = normal::pose_cost(state, 0, &chosen, &weights);
    let mut damping = 1e-6;
    for _ in 0..STEPS {
        pose_normal(&mut normal, state, 0, &chosen, &weights, &nothing);
        let step = damped_step(&normal, damping)?;
        let before = state.poses[0];
        state.poses[0] = moved(&before, &step);
        let next = normal::pose_cost(state, 0, &chosen, &weights);
        let better = next <= cost * (1.0 + 1e-13);
        if !better {
            state.poses[0] = before;
            damping *= 100.0;
            continue;
        }
        (cost, damping) = (next, damping * 0.1);
        if step.dot(&normal.pose_pull) < 1e-10 {
            break;
        }
    }
    cost.is_finite().then_some(state.poses[0])
}

fn damped_step(normal: &PoseNormal, damping: f64) -> Option<Vector6<f64>> {
    let mut matrix: Matrix6<f64> = normal.pose;
    (0..6).for_each(|k| matrix[(k, k)] *= 1.0 + damping);
    Some(matrix.cholesky()?.solve(&normal.pose_pull))
}

/// The shared numbers of `state`, and this pose alone.
pub(super) fn alone(state: &State, pose: Isometry3<f64>) -> State {
    State { poses: vec![pose], ..shared_only(state) }
}

fn shared_only(state: &State) -> State {
    let State { lenses, second_from_first, shape_m, left, right, poses: _ } = state;
    State {
        lenses: *lenses,
        second_from_first: *second_from_first,
        shape_m: *shape_m,
        left: *left,
        right: *right,
        poses: Vec::new(),
    }
}
