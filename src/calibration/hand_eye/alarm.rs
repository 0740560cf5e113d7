//! Solvers of a panel that disagree by more than the poses explain.
//!
//! All solvers see the same poses, so their answers differ by far less than each of them scatters; more than
//! five sigma means that something breaks the equation that they share.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::{HandEyeMethod, METHODS, Solution, Uncertainty};

/// The panel may differ by this many sigma of the jackknife. Normal errors keep to 5 sigma but once in 1.7 million.
const TIMES_SIGMA: f64 = 5.0;
/// Less than this is never an alarm, m: a jackknife of few poses may be small by chance.
const FLOOR_M: f64 = 1e-3;

impl HandEyeMethod {
    /// Its name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Refined => "refined",
            Self::Tsai => "tsai",
            Self::Park => "park",
            Self::Horaud => "horaud",
            Self::Andreff => "andreff",
            Self::Daniilidis => "daniilidis",
            Self::Shah => "shah",
            Self::Li => "li",
        }
    }

    /// Whether its answer counts where the solvers of a panel are compared.
    ///
    /// Li's does not: with noise it lies millimetres from the others on healthy poses, so that it tells nothing.
    pub fn counts_in_spread(self) -> bool {
        self != Self::Li
    }
}

/// A sentence that names the solver that stands apart, where the panel differs by more than the sigma explains.
pub fn disagreement<S: Solution>(panel: &BTreeMap<HandEyeMethod, S>, sigma: &Uncertainty) -> Option<String> {
    let counted = || METHODS.into_iter().filter(|m| m.counts_in_spread());
    let places: Vec<_> = counted().filter_map(|m| Some((m, panel.get(&m)?.camera().translation.vector))).collect();
    let middle = median(&places);
    let off_m = |at: &Vector3<f64>| (at - middle).norm();
    let (apart, at) = places.iter().max_by(|a, b| off_m(&a.1).total_cmp(&off_m(&b.1)))?;
    let (from, there) = places.iter().max_by(|a, b| (a.1 - at).norm().total_cmp(&(b.1 - at).norm()))?;
    let spread_m = (at - there).norm();
    let sigma_m = Vector3::from(sigma.translation_sigma_m).norm();
    let limit_m = FLOOR_M.max(TIMES_SIGMA * sigma_m);
    // A spread that is no number is an alarm too.
    if spread_m <= limit_m {
        return None;
    }
    let (apart, from, [spread_mm, sigma_mm]) = (apart.name(), from.name(), [spread_m, sigma_m].map(|v| v * 1e3));
    Some(format!(
        "hand-eye: the solvers disagree: {apart} puts the camera {spread_mm:.2} mm from where {from} does, {:.1} times the \
         sigma of {sigma_mm:.2} mm; look for poses paired wrongly, a wrong square size or poor intrinsics",
        spread_m / sigma_m
    ))
}

/// The middle value along each axis; zero without any.
fn median(places: &[(HandEyeMethod, Vector3<f64>)]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| {
        let mut values: Vec<f64> = places.iter().map(|(_, at)| at[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    })
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{noisy, paper_cell, seen_by_static, spread_poses};
    use super::super::{EyeToHand, jackknife, panel};
    use super::*;
    use crate::geometry::{Sensor, Transform};

    fn ids() -> Vec<String> {
        (0..12).map(|i| format!("pose {i}")).collect()
    }

    #[test]
    fn healthy_noise_is_no_alarm_and_a_solver_that_stands_apart_is_named() {
        for seed in 0..20 {
            let pairs = noisy(&seen_by_static(&paper_cell(), &spread_poses(12, 0.6, 71)), 0.5e-3, 1e-3, seed);
            let sigma = jackknife::<EyeToHand>(HandEyeMethod::Tsai, &pairs, &ids()).unwrap().uncertainty;
            let mut solved = panel::<EyeToHand>(&pairs).0;
            assert_eq!(disagreement(&solved, &sigma), None);
            let sigma_m = Vector3::from(sigma.translation_sigma_m).norm();
            for method in [HandEyeMethod::Tsai, HandEyeMethod::Shah, HandEyeMethod::Li] {
                let mut spoilt = solved.clone();
                let by = Transform::<Sensor, Sensor>::from_pose_vector([2e-3 + 8.0 * sigma_m, 0.0, 0.0, 0.0, 0.0, 0.0]);
                let moved = spoilt.get_mut(&method).unwrap();
                moved.base_from_camera = moved.base_from_camera * by;
                let said = disagreement(&spoilt, &sigma);
                let named = said.as_ref().is_some_and(|s| s.contains(&format!("disagree: {} puts", method.name())));
                assert_eq!(named, method.counts_in_spread(), "{method:?}: {said:?}");
            }
            solved.retain(|method, _| *method == HandEyeMethod::Tsai);
            assert_eq!(disagreement(&solved, &sigma), None);
        }
    }

    #[test]
    fn an_answer_that_is_no_number_is_an_alarm() {
        let pairs = seen_by_static(&paper_cell(), &spread_poses(12, 0.6, 71));
        let sigma = jackknife::<EyeToHand>(HandEyeMethod::Tsai, &pairs, &ids()).unwrap().uncertainty;
        let mut solved = panel::<EyeToHand>(&pairs).0;
        assert_eq!(disagreement(&solved, &sigma), None);
        solved.get_mut(&HandEyeMethod::Park).unwrap().base_from_camera =
            Transform::from_pose_vector([f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(disagreement(&solved, &sigma).is_some());
    }
}
