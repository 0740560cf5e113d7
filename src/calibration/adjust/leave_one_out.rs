//! What every answer would be without one pose: the pose's part is taken out of the normal equations, and they are
//! solved again. Exact where the problem is linear; tested against true solves.

use super::fit::{Arrived, Fit};
use super::normal::Factor;
use super::state::{Active, SharedMatrix, SharedVector};

/// The step of the shared numbers when each pose is left out, in order; `None` for a pose that nothing replaces.
pub(super) fn steps(arrived: &Arrived, active: &Active) -> Vec<Option<SharedVector>> {
    let without = |one: &super::normal::Reduced| {
        let matrix = arrived.matrix - one.matrix;
        let factor = Factor::of(&matrix, active, 0.0)?;
        Some(factor.solve(&(arrived.pull - one.pull), active))
    };
    arrived.reduced.iter().map(without).collect()
}

/// Jackknife covariance of the shared numbers; `None` where one pose is indispensable.
pub(super) fn covariance(steps: &[Option<SharedVector>]) -> Option<SharedMatrix> {
    let steps: Vec<&SharedVector> = steps.iter().map(Option::as_ref).collect::<Option<_>>()?;
    let n = steps.len() as f64;
    let mean: SharedVector = steps.iter().copied().sum::<SharedVector>() / n;
    let mut sum = SharedMatrix::zeros();
    for step in &steps {
        let off = *step - mean;
        sum.ger(1.0, &off, &off, 1.0);
    }
    let enough = n > 1.0;
    enough.then(|| sum * ((n - 1.0) / n))
}

/// The state without pose `at`, by its step.
pub(super) fn state_without(fit: &Fit, step: &SharedVector) -> super::state::State {
    let mut state = fit.state.clone();
    state.step_shared(step);
    state
}
