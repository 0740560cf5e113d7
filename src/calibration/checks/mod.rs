//! Checks of a hand-eye result against mechanical truths: distances that must come out right.
//!
//! Target to TCP tests the whole chain, for every pose. Its mean hides errors (5 mm and 0.5 deg in the
//! camera's place moved it by 0.03 mm) and its scatter shows them (2.75 mm): gate on sigma and on the
//! largest error. The distance between two poses is the same for every rigid camera place, so it tests
//! cameras and board poses only; the displacement vector against the robot's own tests the camera's
//! rotation too. Uses `geometry` and `hand_eye`. Start at [`target_to_tcp`].

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::hand_eye::{EyeInHand, EyeToHand};
use super::problem::DistancePair;
use crate::geometry::{Base, Point, Sensor, Target, Tcp, Transform};

#[cfg(test)]
mod tests;

/// Relative rotations below this count as a pure translation, radians (0.1 deg).
pub const PURE_TRANSLATION_RAD: f64 = 0.1 * std::f64::consts::PI / 180.0;

/// The board at one pose, as the camera saw it, and the robot's own pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// Id of the pose.
    pub pose_id: String,
    /// From the camera.
    pub camera_from_target: Transform<Sensor, Target>,
    /// From the robot, where it was recorded.
    pub base_from_tcp: Option<Transform<Base, Tcp>>,
    /// Whether the pose was kept out of the hand-eye fit.
    pub held_out: bool,
}

/// The corner that is checked.
#[derive(Debug, Clone, Copy)]
pub struct CheckedCorner {
    /// Id on the board.
    pub corner_id: u32,
    /// Where it is on the board.
    pub corner_in_target: Point<Target>,
    /// Its mechanical distance to the TCP, where known, m.
    pub truth_m: Option<f64>,
}

/// Numbers of a set of distances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DistanceScore {
    /// Number of poses.
    pub count: usize,
    /// Mean distance, m.
    pub mean_m: f64,
    /// Standard deviation (n - 1), m; absent for one pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Mean error, m; like all errors absent without a known truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias_m: Option<f64>,
    /// Mean |error| per pose, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mae_m: Option<f64>,
    /// Largest |error|, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_m: Option<f64>,
    /// Largest distance from the mean, m.
    pub max_from_mean_m: f64,
}

/// Distance of a corner of the carried target from the TCP, which should be the same at every pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TargetToTcp {
    /// Id of the corner.
    pub corner_id: u32,
    /// Number of poses, in the fit or not; the numbers that follow are over all of them.
    pub count: usize,
    /// Mean distance, m.
    pub mean_m: f64,
    /// Standard deviation (n - 1), m; absent for one pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// The mechanical distance, m; absent where unknown, and with it all errors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth_m: Option<f64>,
    /// Mean error, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias_m: Option<f64>,
    /// Mean |error| per pose, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mae_m: Option<f64>,
    /// Largest |error|, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_m: Option<f64>,
    /// Largest distance from the mean, m.
    pub max_from_mean_m: f64,
    /// The same numbers over the poses that were kept out of the fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out: Option<DistanceScore>,
    /// The same numbers over the poses of the fit, each with the answer of all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leave_one_out: Option<DistanceScore>,
    /// Every pose.
    pub per_pose: Vec<PoseDistance>,
}

/// The distance at one pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseDistance {
    /// Id of the pose.
    pub pose_id: String,
    /// The distance, m.
    pub distance_m: f64,
    /// Its error, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error_m: Option<f64>,
    /// Whether the pose was kept out of the fit.
    pub held_out: bool,
    /// The distance with the answer of all other poses, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leave_one_out_m: Option<f64>,
}

/// Measures the distance of a corner from the TCP at every pose with a robot pose.
///
/// `without` has the answers without one pose of the fit, by pose id; empty skips that score. `None`
/// where there is no pose, or a number is not finite.
pub fn target_to_tcp(
    corner: &CheckedCorner,
    solution: &EyeToHand,
    without: &BTreeMap<String, EyeToHand>,
    sightings: &[Sighting],
) -> Option<TargetToTcp> {
    let per_pose: Vec<_> = sightings.iter().filter_map(|s| pose_distance(corner, solution, without, s)).collect();
    let score_of = |distances: Vec<f64>| score(&distances, corner.truth_m);
    let all = score_of(per_pose.iter().map(|p| p.distance_m).collect())?;
    let DistanceScore { count, mean_m, sigma_m, bias_m, mae_m, max_m, max_from_mean_m } = all;
    Some(TargetToTcp {
        corner_id: corner.corner_id,
        count,
        mean_m,
        sigma_m,
        truth_m: corner.truth_m,
        bias_m,
        mae_m,
        max_m,
        max_from_mean_m,
        held_out: score_of(per_pose.iter().filter(|p| p.held_out).map(|p| p.distance_m).collect()),
        leave_one_out: score_of(per_pose.iter().filter_map(|p| p.leave_one_out_m).collect()),
        per_pose,
    })
}

fn pose_distance(
    corner: &CheckedCorner,
    solution: &EyeToHand,
    without: &BTreeMap<String, EyeToHand>,
    sighting: &Sighting,
) -> Option<PoseDistance> {
    let base_from_tcp = sighting.base_from_tcp?;
    let corner_in_camera = sighting.camera_from_target * corner.corner_in_target;
    let distance_m = |by: &EyeToHand| {
        let corner_in_tcp = base_from_tcp.inverse() * (by.base_from_camera * corner_in_camera);
        corner_in_tcp.coords_m().norm()
    };
    let distance = distance_m(solution);
    Some(PoseDistance {
        pose_id: sighting.pose_id.clone(),
        distance_m: distance,
        error_m: corner.truth_m.map(|truth_m| distance - truth_m),
        held_out: sighting.held_out,
        leave_one_out_m: without.get(&sighting.pose_id).filter(|_| !sighting.held_out).map(distance_m),
    })
}

/// `None` for no distances, or where one is not finite.
fn score(distances_m: &[f64], truth_m: Option<f64>) -> Option<DistanceScore> {
    let mean_m = mean(distances_m.iter().copied())?;
    let errors = |of: &dyn Fn(f64) -> f64| truth_m.map(|t| distances_m.iter().map(|d| of(d - t)).collect::<Vec<_>>());
    let absolute = errors(&f64::abs);
    Some(DistanceScore {
        count: distances_m.len(),
        mean_m,
        sigma_m: sigma(distances_m.iter().map(|d| d - mean_m)),
        bias_m: truth_m.map(|t| mean_m - t),
        mae_m: absolute.as_ref().and_then(|e| mean(e.iter().copied())),
        max_m: absolute.map(|e| largest(e.into_iter())),
        max_from_mean_m: largest(distances_m.iter().map(|d| (d - mean_m).abs())),
    })
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    let count = values.len();
    let mean = values.sum::<f64>() / count as f64;
    mean.is_finite().then_some(mean)
}

/// Root of the sum of squares over n - 1; `None` for fewer than two.
fn sigma(from_mean: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    let count = from_mean.len();
    let squares = from_mean.map(|v| v * v).sum::<f64>();
    (count > 1).then(|| (squares / (count - 1) as f64).sqrt())
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

/// Place of a corner of the static target in `base`, which should be the same at every pose.
///
/// The check of a cell that carries its cameras.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TargetInBase {
    /// Id of the corner.
    pub corner_id: u32,
    /// Numbers over all poses, in the fit or not.
    pub count: usize,
    /// Mean place in `base`, m.
    pub mean_m: [f64; 3],
    /// Root of the sum of squared distances from the mean over n - 1, m; absent for one pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Largest distance from the mean, m.
    pub max_m: f64,
    /// The same numbers over the poses that were kept out of the fit, about their own mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out: Option<PlaceScore>,
    /// The same numbers over the poses of the fit, each with the answer of all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leave_one_out: Option<PlaceScore>,
    /// Every pose.
    pub per_pose: Vec<PosePlace>,
}

/// Numbers of a set of places.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlaceScore {
    /// Number of poses.
    pub count: usize,
    /// Mean place in `base`, m.
    pub mean_m: [f64; 3],
    /// Root of the sum of squared distances from the mean over n - 1, m; absent for one pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Largest distance from the mean, m.
    pub max_m: f64,
}

/// The place at one pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PosePlace {
    /// Id of the pose.
    pub pose_id: String,
    /// The place in `base`, m.
    pub position_m: [f64; 3],
    /// Its distance from the mean of all poses, m.
    pub error_m: f64,
    /// Whether the pose was kept out of the fit.
    pub held_out: bool,
}

/// Measures the place of a corner in `base` at every pose with a robot pose; as [`target_to_tcp`].
pub fn target_in_base(
    corner: &CheckedCorner,
    solution: &EyeInHand,
    without: &BTreeMap<String, EyeInHand>,
    sightings: &[Sighting],
) -> Option<TargetInBase> {
    let place = |by: &EyeInHand, s: &Sighting| {
        let corner_in_tcp = by.tcp_from_camera * (s.camera_from_target * corner.corner_in_target);
        s.base_from_tcp.map(|base_from_tcp| (base_from_tcp * corner_in_tcp).coords_m())
    };
    let seen: Vec<_> = sightings.iter().filter_map(|s| Some((s, place(solution, s)?))).collect();
    let all = place_score(&seen.iter().map(|(_, p)| *p).collect::<Vec<_>>())?;
    let held_out: Vec<_> = seen.iter().filter(|(s, _)| s.held_out).map(|(_, p)| *p).collect();
    let fitted = sightings.iter().filter(|s| !s.held_out);
    let left_out: Vec<_> = fitted.filter_map(|s| place(without.get(&s.pose_id)?, s)).collect();
    let pose_place = |(s, p): (&Sighting, Vector3<f64>)| PosePlace {
        pose_id: s.pose_id.clone(),
        position_m: p.into(),
        error_m: (p - Vector3::from(all.mean_m)).norm(),
        held_out: s.held_out,
    };
    let PlaceScore { count, mean_m, sigma_m, max_m } = all;
    Some(TargetInBase {
        corner_id: corner.corner_id,
        count,
        mean_m,
        sigma_m,
        max_m,
        held_out: place_score(&held_out),
        leave_one_out: place_score(&left_out),
        per_pose: seen.into_iter().map(pose_place).collect(),
    })
}

/// `None` for no places, or where one is not finite.
fn place_score(places_m: &[Vector3<f64>]) -> Option<PlaceScore> {
    let mean_m = places_m.iter().sum::<Vector3<f64>>() / places_m.len() as f64;
    let from_mean = || places_m.iter().map(|p| (p - mean_m).norm());
    mean_m.iter().all(|v| v.is_finite()).then(|| PlaceScore {
        count: places_m.len(),
        mean_m: mean_m.into(),
        sigma_m: sigma(from_mean()),
        max_m: largest(from_mean()),
    })
}

/// Distances of one corner between poses that are a known distance apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BaseDistance {
    /// Number of pairs.
    pub count: usize,
    /// Mean error, m.
    pub bias_m: f64,
    /// Mean |error|, m.
    pub mae_m: f64,
    /// Standard deviation (n - 1) of the error, m; absent for one pair.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Largest |error|, m.
    pub max_m: f64,
    /// Mean length of the error of the displacement vector, m; absent without robot poses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector_mae_m: Option<f64>,
    /// Largest such length, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector_max_m: Option<f64>,
    /// Every pair.
    pub per_pair: Vec<PairDistance>,
}

/// The distance between two poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairDistance {
    /// Name of the pair.
    pub pair: String,
    /// Id of the first pose.
    pub pose_a: String,
    /// Id of the second pose.
    pub pose_b: String,
    /// The distance, m.
    pub distance_m: f64,
    /// The known distance, m.
    pub truth_m: f64,
    /// Difference of both, m.
    pub error_m: f64,
    /// Length of the difference between the displacement in `base` and the robot's own, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vector_error_m: Option<f64>,
    /// Whether the robot turned by less than 0.1 deg in between, so that its own displacement needs
    /// nothing of the hand-eye result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pure_translation: Option<bool>,
}

/// Measures the corner's distance and displacement between the poses of each pair.
///
/// Pairs of which a pose was not seen are left out; `None` where none is left or a number is not finite.
/// Without a hand-eye result, distances are taken in the camera, which is the same, and no vectors.
pub fn base_distance(
    corner: &CheckedCorner,
    solution: Option<&EyeToHand>,
    pairs: &[DistancePair],
    sightings: &[Sighting],
) -> Option<BaseDistance> {
    let per_pair: Vec<_> = pairs.iter().filter_map(|p| pair_distance(corner, solution, p, sightings)).collect();
    let bias_m = mean(per_pair.iter().map(|p| p.error_m))?;
    let vectors: Vec<f64> = per_pair.iter().filter_map(|p| p.vector_error_m).collect();
    let vector_mae_m = mean(vectors.iter().copied());
    Some(BaseDistance {
        count: per_pair.len(),
        bias_m,
        mae_m: mean(per_pair.iter().map(|p| p.error_m.abs()))?,
        sigma_m: sigma(per_pair.iter().map(|p| p.error_m - bias_m)),
        max_m: largest(per_pair.iter().map(|p| p.error_m.abs())),
        vector_mae_m,
        vector_max_m: vector_mae_m.map(|_| largest(vectors.into_iter())),
        per_pair,
    })
}

fn pair_distance(
    corner: &CheckedCorner,
    solution: Option<&EyeToHand>,
    pair: &DistancePair,
    sightings: &[Sighting],
) -> Option<PairDistance> {
    let find = |id: &str| sightings.iter().find(|s| s.pose_id == id);
    let (a, b) = (find(&pair.pose_a)?, find(&pair.pose_b)?);
    let [in_camera_a, in_camera_b] = [a, b].map(|s| s.camera_from_target * corner.corner_in_target);
    let displacement = solution.map(|s| {
        let [in_base_a, in_base_b] = [in_camera_a, in_camera_b].map(|p| s.base_from_camera * p);
        in_base_a.coords_m() - in_base_b.coords_m()
    });
    let distance_m = displacement.map_or_else(|| in_camera_a.distance_m(in_camera_b), |d| d.norm());
    let robot = solution.and_then(|s| Some((s, a.base_from_tcp?, b.base_from_tcp?)));
    let own = robot.map(|(s, tcp_a, tcp_b)| robot_displacement_m(corner, s, tcp_a, tcp_b));
    Some(PairDistance {
        pair: pair.name.clone(),
        pose_a: pair.pose_a.clone(),
        pose_b: pair.pose_b.clone(),
        distance_m,
        truth_m: pair.truth_m,
        error_m: distance_m - pair.truth_m,
        vector_error_m: displacement.zip(own).map(|(seen, own)| (seen - own).norm()),
        pure_translation: robot.map(|(_, tcp_a, tcp_b)| tcp_a.angle_to_rad(&tcp_b) < PURE_TRANSLATION_RAD),
    })
}

/// How the robot itself says that the corner moved from pose b to pose a, in `base`.
///
/// For a pure translation it is that of the TCP, whatever `tcp_from_target` is.
fn robot_displacement_m(
    corner: &CheckedCorner,
    solution: &EyeToHand,
    base_from_tcp_a: Transform<Base, Tcp>,
    base_from_tcp_b: Transform<Base, Tcp>,
) -> Vector3<f64> {
    let corner_in_tcp = solution.tcp_from_target * corner.corner_in_target;
    (base_from_tcp_a * corner_in_tcp).coords_m() - (base_from_tcp_b * corner_in_tcp).coords_m()
}
