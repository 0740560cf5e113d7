//! Hand-eye: where the camera is, from poses of the robot and of the board before the camera.
//!
//! Seven closed forms for both set-ups: the robot carries the target ([`EyeToHand`]) or the cameras
//! ([`EyeInHand`]). Five are on the equation `A X = X B` of all relative motions, two on `A X = Z B` of all
//! poses. The choice hardly matters on healthy poses; a panel that disagrees is an alarm. Uses `geometry`
//! and `observability`. Start at [`solve_eye_to_hand`]; [`motion`] has the core, one file per solver of
//! motions beside it, [`robot_world`] those of poses.

mod alarm;
mod andreff;
mod daniilidis;
#[cfg(test)]
pub(in crate::calibration) mod fixture;
mod horaud;
mod motion;
mod park;
mod robot_world;
mod spread;
#[cfg(test)]
mod tests;
mod tsai;

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

pub use super::settings::HandEyeMethod;
pub use alarm::disagreement;
pub use spread::{
    Influence, Jackknife, PanelSpread, Residual, Uncertainty, UncertaintyMethod, jackknife, panel, panel_spread,
    residuals,
};

use super::observability::{self, ObservabilityError};
use crate::geometry::{Base, Sensor, Target, Tcp, Transform};
use robot_world::Both;

/// All solvers, in the order of every table.
pub const METHODS: [HandEyeMethod; 7] = [
    HandEyeMethod::Tsai,
    HandEyeMethod::Park,
    HandEyeMethod::Horaud,
    HandEyeMethod::Andreff,
    HandEyeMethod::Daniilidis,
    HandEyeMethod::Shah,
    HandEyeMethod::Li,
];

/// The robot and the board at the same instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// From the robot.
    pub base_from_tcp: Transform<Base, Tcp>,
    /// From the camera.
    pub camera_from_target: Transform<Sensor, Target>,
}

/// The answer where the robot carries the target before a static camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EyeToHand {
    /// Where the camera stands.
    pub base_from_camera: Transform<Base, Sensor>,
    /// How the target sits on the tool: mean over the poses, or what a solver of both says.
    pub tcp_from_target: Transform<Tcp, Target>,
}

/// The answer where the robot carries the camera before a static target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EyeInHand {
    /// How the camera sits on the tool.
    pub tcp_from_camera: Transform<Tcp, Sensor>,
    /// Where the target stands: mean over the poses, or what a solver of both says.
    pub base_from_target: Transform<Base, Target>,
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HandEyeError {
    /// Too few poses, poses that are not finite, or rotations that do not span space.
    #[error(transparent)]
    Unobservable(#[from] ObservabilityError),
    /// A board pose is NaN or infinite.
    #[error("the board pose of pair {pair} is not finite: drop the pair or repair its source")]
    NotFinite {
        /// Index in the set, from 0.
        pair: usize,
    },
    /// Several rotations explain the motions.
    #[error(
        "the {pairs} pairs fit more than one camera rotation (uniqueness {found:.4}, at least {allowed} is needed): half \
         turns only, or board poses that do not belong to the robot poses; add poses turned by 20 to 60 deg about two axes"
    )]
    Ambiguous {
        /// Number of pairs.
        pairs: usize,
        /// Ratio of the second smallest to the largest singular value of `R_A X - X R_B`, at most 1.
        found: f64,
        /// Smallest allowed.
        allowed: f64,
    },
    /// The numbers broke down.
    #[error("{method:?} found no finite solution for {pairs} pairs: are translations in metres and pairs in order?")]
    Breakdown {
        /// The solver.
        method: HandEyeMethod,
        /// Number of pairs.
        pairs: usize,
    },
    /// Without one of the poses there is no answer, so its influence cannot be told.
    #[error("everything hangs on pair {pair}, because without it: {why}")]
    HangsOnOne {
        /// Index in the set, from 0.
        pair: usize,
        /// Why the others alone have no answer.
        why: Box<HandEyeError>,
    },
}

/// Finds where a static camera stands, from poses of a target that the robot carries.
///
/// At least 3 pairs, whose robot poses turn about two axes that differ clearly.
pub fn solve_eye_to_hand(method: HandEyeMethod, pairs: &[Pair]) -> Result<EyeToHand, HandEyeError> {
    let poses: Vec<_> = pairs.iter().map(|p| p.base_from_tcp).collect();
    observability::carried_target(&poses)?.check()?;
    // tcp_from_base * base_from_camera * camera_from_target is the same at every pose.
    let loops: Vec<_> = pairs.iter().map(|p| (p.base_from_tcp.iso().inverse(), *p.camera_from_target.iso())).collect();
    let Both { x, z } = solve(method, &loops)?;
    Ok(EyeToHand { base_from_camera: Transform::assume_frames(x), tcp_from_target: Transform::assume_frames(z) })
}

/// Finds how a carried camera sits on the tool, from poses of a static target.
///
/// At least 3 pairs, whose robot poses turn about two axes that differ clearly.
pub fn solve_eye_in_hand(method: HandEyeMethod, pairs: &[Pair]) -> Result<EyeInHand, HandEyeError> {
    let poses: Vec<_> = pairs.iter().map(|p| p.base_from_tcp).collect();
    observability::carried_cameras(&poses)?.check()?;
    // base_from_tcp * tcp_from_camera * camera_from_target is the same at every pose.
    let loops: Vec<_> = pairs.iter().map(|p| (*p.base_from_tcp.iso(), *p.camera_from_target.iso())).collect();
    let Both { x, z } = solve(method, &loops)?;
    Ok(EyeInHand { tcp_from_camera: Transform::assume_frames(x), base_from_target: Transform::assume_frames(z) })
}

impl Pair {
    /// How the target sits on the tool, as this pair has it through a static camera.
    pub fn tcp_from_target(&self, base_from_camera: &Transform<Base, Sensor>) -> Transform<Tcp, Target> {
        self.base_from_tcp.inverse() * *base_from_camera * self.camera_from_target
    }

    /// Where the target stands, as this pair has it through a carried camera.
    pub fn base_from_target(&self, tcp_from_camera: &Transform<Tcp, Sensor>) -> Transform<Base, Target> {
        self.base_from_tcp * *tcp_from_camera * self.camera_from_target
    }
}

/// The answer of either set-up, for what is the same for both.
pub trait Solution: Copy {
    /// Solves for this set-up.
    fn solve(method: HandEyeMethod, pairs: &[Pair]) -> Result<Self, HandEyeError>;
    /// The unknown that the solver finds: `base_from_camera` or `tcp_from_camera`.
    fn camera(&self) -> Isometry3<f64>;
    /// The other one: `tcp_from_target` or `base_from_target`.
    fn target(&self) -> Isometry3<f64>;
    /// The same, as one pair has it through the camera.
    fn target_by(&self, pair: &Pair) -> Isometry3<f64>;
}

impl Solution for EyeToHand {
    fn solve(method: HandEyeMethod, pairs: &[Pair]) -> Result<Self, HandEyeError> {
        solve_eye_to_hand(method, pairs)
    }
    fn camera(&self) -> Isometry3<f64> {
        *self.base_from_camera.iso()
    }
    fn target(&self) -> Isometry3<f64> {
        *self.tcp_from_target.iso()
    }
    fn target_by(&self, pair: &Pair) -> Isometry3<f64> {
        *pair.tcp_from_target(&self.base_from_camera).iso()
    }
}

impl Solution for EyeInHand {
    fn solve(method: HandEyeMethod, pairs: &[Pair]) -> Result<Self, HandEyeError> {
        solve_eye_in_hand(method, pairs)
    }
    fn camera(&self) -> Isometry3<f64> {
        *self.tcp_from_camera.iso()
    }
    fn target(&self) -> Isometry3<f64> {
        *self.base_from_target.iso()
    }
    fn target_by(&self, pair: &Pair) -> Isometry3<f64> {
        *pair.base_from_target(&self.tcp_from_camera).iso()
    }
}

/// `X` and `Z` such that `A_i X B_i` is `Z` for all i; the loops are `(A_i, B_i)`.
fn solve(method: HandEyeMethod, loops: &[(Isometry3<f64>, Isometry3<f64>)]) -> Result<Both, HandEyeError> {
    let finite = |iso: &Isometry3<f64>| iso.to_homogeneous().iter().all(|v| v.is_finite());
    if let Some(pair) = loops.iter().position(|(_, b)| !finite(b)) {
        return Err(HandEyeError::NotFinite { pair });
    }
    // Refuses what no solver can answer, also for those that do not use motions.
    let motions = motion::Motions::of(method, loops)?;
    let found = match method {
        HandEyeMethod::Tsai | HandEyeMethod::Refined => {
            by_motions(loops, &motions, motions.with_translation(tsai::rotation(&motions)))
        }
        HandEyeMethod::Park => by_motions(loops, &motions, motions.with_translation(park::rotation(&motions))),
        HandEyeMethod::Horaud => by_motions(loops, &motions, motions.with_translation(horaud::rotation(&motions))),
        HandEyeMethod::Andreff => by_motions(loops, &motions, motions.with_translation(andreff::rotation(&motions))),
        HandEyeMethod::Daniilidis => by_motions(loops, &motions, daniilidis::solve(&motions)),
        HandEyeMethod::Shah => robot_world::shah(loops),
        HandEyeMethod::Li => robot_world::li(loops),
    };
    found.filter(|both| finite(&both.x) && finite(&both.z)).ok_or(breakdown(method, loops.len()))
}

/// Turns the camera frame back; `Z` is the mean of what the loops say.
fn by_motions(
    loops: &[(Isometry3<f64>, Isometry3<f64>)],
    motions: &motion::Motions,
    turned: Option<Isometry3<f64>>,
) -> Option<Both> {
    let x = turned? * motions.prior;
    let seen: Vec<_> = loops.iter().map(|(a, b)| a * x * b).collect();
    Some(Both { x, z: motion::mean(seen.iter())? })
}

fn breakdown(method: HandEyeMethod, pairs: usize) -> HandEyeError {
    HandEyeError::Breakdown { method, pairs }
}
