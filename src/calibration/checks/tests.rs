//! Known distances first, then noise, then what is absent.

use super::super::hand_eye::fixture::{noisy, paper_cell, seen_by_carried, seen_by_static, spread_poses};
use super::super::hand_eye::{HandEyeMethod, Pair, jackknife, solve_eye_to_hand};
use super::*;
use crate::geometry::rotation;

const CORNER: [f64; 3] = [0.0352, 0.0176, 0.0];

fn sightings(pairs: &[Pair], held_out_from: usize) -> Vec<Sighting> {
    let sighting = |(i, pair): (usize, &Pair)| Sighting {
        pose_id: format!("p{i}"),
        camera_from_target: pair.camera_from_target,
        base_from_tcp: Some(pair.base_from_tcp),
        held_out: i >= held_out_from,
    };
    pairs.iter().enumerate().map(sighting).collect()
}

fn true_distance_m() -> f64 {
    (paper_cell().tcp_from_target * Point::assume_frame(CORNER)).coords_m().norm()
}

fn corner() -> CheckedCorner {
    CheckedCorner { corner_id: 9, corner_in_target: Point::assume_frame(CORNER), truth_m: Some(true_distance_m()) }
}

fn without_any() -> BTreeMap<String, EyeToHand> {
    BTreeMap::new()
}

#[test]
fn a_perfect_cell_has_the_true_distance_at_every_pose() {
    let seen = sightings(&seen_by_static(&paper_cell(), &spread_poses(10, 0.6, 1)), 7);
    let check = target_to_tcp(&corner(), &paper_cell(), &without_any(), &seen).unwrap();
    assert_eq!((check.corner_id, check.count, check.per_pose.len()), (9, 10, 10));
    assert!((check.mean_m - true_distance_m()).abs() < 1e-12 && check.sigma_m.unwrap() < 1e-12);
    assert!(check.max_m.unwrap() < 1e-12 && check.mae_m.unwrap() < 1e-12 && check.bias_m.unwrap().abs() < 1e-12);
    assert_eq!(check.held_out.unwrap().count, 3);
    assert!(check.leave_one_out.is_none());
}

#[test]
fn the_numbers_are_what_they_are_called() {
    let score = score(&[1.0, 2.0, 6.0], Some(2.5)).unwrap();
    assert_eq!((score.count, score.mean_m, score.bias_m), (3, 3.0, Some(0.5)));
    assert!((score.sigma_m.unwrap() - 7.0_f64.sqrt()).abs() < 1e-12, "4 + 1 + 9 over n - 1");
    assert!((score.mae_m.unwrap() - 5.5 / 3.0).abs() < 1e-12);
    assert_eq!((score.max_m, score.max_from_mean_m), (Some(3.5), 3.0));
    let one = super::score(&[1.0], None).unwrap();
    assert_eq!((one.sigma_m, one.bias_m, one.mae_m, one.max_m), (None, None, None, None));
    assert!(super::score(&[], None).is_none() && super::score(&[1.0, f64::NAN], None).is_none());
}

/// Fact of the method: an error of 5 mm and 0.5 deg across the corner's mean direction hides in the mean.
#[test]
fn an_error_of_the_camera_shows_in_sigma_and_not_in_the_mean() {
    let truth = paper_cell();
    let poses = spread_poses(200, 0.8, 2);
    let in_tcp = (truth.tcp_from_target * Point::assume_frame(CORNER)).coords_m();
    let along = poses.iter().map(|p| p.rotation() * in_tcp).sum::<Vector3<f64>>().normalize();
    let (across, turn) = (along.cross(&Vector3::z()).normalize() * 0.005, along * 0.5_f64.to_radians());
    let error = Transform::<Base, Base>::from_parts(across.into(), rotation::from_vector(turn.into()));
    let wrong = EyeToHand { base_from_camera: error * truth.base_from_camera, ..truth };
    let seen = sightings(&seen_by_static(&truth, &poses), 200);
    let check = target_to_tcp(&corner(), &wrong, &without_any(), &seen).unwrap();
    let (bias_m, sigma_m) = (check.bias_m.unwrap().abs(), check.sigma_m.unwrap());
    eprintln!("bias {bias_m:.6} m, sigma {sigma_m:.6} m, max {:.6} m", check.max_m.unwrap());
    assert!(sigma_m > 2e-3 && check.max_m.unwrap() > 4e-3, "{sigma_m}");
    assert!(bias_m < 0.25 * sigma_m, "{bias_m} {sigma_m}");
}

#[test]
fn leave_one_out_scores_each_pose_by_the_others() {
    let pairs = noisy(&seen_by_static(&paper_cell(), &spread_poses(8, 0.6, 3)), 0.5e-3, 2e-3, 5);
    let (fit, ids) = (&pairs[..6], (0..6).map(|i| format!("p{i}")).collect::<Vec<_>>());
    let solution = solve_eye_to_hand(HandEyeMethod::Tsai, fit).unwrap();
    let left_out = jackknife::<EyeToHand>(HandEyeMethod::Tsai, fit, &ids).unwrap().without;
    let without = ids.into_iter().zip(left_out).collect();
    let check = target_to_tcp(&corner(), &solution, &without, &sightings(&pairs, 6)).unwrap();
    let leave_one_out = check.leave_one_out.unwrap();
    assert_eq!((check.count, leave_one_out.count, check.held_out.unwrap().count), (8, 6, 2));
    let by_hand = fit[2].base_from_tcp.inverse()
        * without["p2"].base_from_camera
        * (fit[2].camera_from_target * Point::assume_frame(CORNER));
    assert!((check.per_pose[2].leave_one_out_m.unwrap() - by_hand.coords_m().norm()).abs() < 1e-15);
    assert!(check.per_pose[7].held_out && check.per_pose[7].leave_one_out_m.is_none());
    let fitted = score(&check.per_pose[..6].iter().map(|p| p.distance_m).collect::<Vec<_>>(), None).unwrap();
    assert!(leave_one_out.sigma_m.unwrap() > fitted.sigma_m.unwrap(), "a pose fits worse when it is not in the fit");
}

#[test]
fn without_a_truth_no_error_is_written() {
    let seen = sightings(&seen_by_static(&paper_cell(), &spread_poses(4, 0.6, 1)), 4);
    let check =
        target_to_tcp(&CheckedCorner { truth_m: None, ..corner() }, &paper_cell(), &without_any(), &seen).unwrap();
    let json = serde_json::to_value(&check).unwrap();
    let has = |key: &str| json.get(key).is_some();
    assert!(["corner_id", "mean_m", "sigma_m", "max_from_mean_m", "per_pose"].into_iter().all(has), "{json}");
    assert!(!["truth_m", "bias_m", "mae_m", "max_m", "held_out", "leave_one_out"].into_iter().any(has), "{json}");
    assert!(json["per_pose"][0].get("error_m").is_none() && !json.to_string().contains("null"), "{json}");
    let again: TargetToTcp = serde_json::from_value(json).unwrap();
    assert_eq!(again, check);
}

#[test]
fn what_cannot_be_computed_is_absent() {
    let mut seen = sightings(&seen_by_static(&paper_cell(), &spread_poses(4, 0.6, 1)), 4);
    assert!(target_to_tcp(&corner(), &paper_cell(), &without_any(), &[]).is_none());
    seen[1].base_from_tcp = None;
    assert_eq!(target_to_tcp(&corner(), &paper_cell(), &without_any(), &seen).unwrap().count, 3);
    seen[2].camera_from_target = Transform::from_parts([f64::NAN; 3], seen[2].camera_from_target.rotation());
    assert!(target_to_tcp(&corner(), &paper_cell(), &without_any(), &seen).is_none());
    let pair = DistancePair { name: "a".into(), pose_a: "p0".into(), pose_b: "p2".into(), truth_m: 0.1 };
    assert!(base_distance(&corner(), Some(&paper_cell()), &[pair], &seen).is_none());
}

/// Poses 0.1 m apart along x, y and z of the base, and one that also turns.
fn stepped() -> (Vec<Sighting>, Vec<DistancePair>) {
    let at = |shift: [f64; 3], turn: [f64; 3]| {
        let rotation = rotation::from_vector(turn) * rotation::from_vector([0.2, 3.0, 0.1]);
        Transform::<Base, Tcp>::from_parts([0.3 + shift[0], shift[1], 0.4 + shift[2]], rotation)
    };
    let turned = at([0.05, 0.05, 0.0], [0.0, 0.3, 0.0]);
    let poses = [
        at([0.0; 3], [0.0; 3]),
        at([0.1, 0.0, 0.0], [0.0; 3]),
        at([0.0, 0.1, 0.0], [0.0; 3]),
        at([0.0, 0.0, 0.1], [0.0; 3]),
        turned,
    ];
    let seen = sightings(&seen_by_static(&paper_cell(), &poses), 0);
    let pair =
        |b: usize| DistancePair { name: format!("0-{b}"), pose_a: "p0".into(), pose_b: format!("p{b}"), truth_m: 0.1 };
    (seen, (1..4).map(pair).collect())
}

#[test]
fn distances_are_blind_to_the_camera_and_vectors_see_its_rotation() {
    let (seen, pairs) = stepped();
    let truth = paper_cell();
    let perfect = base_distance(&corner(), Some(&truth), &pairs, &seen).unwrap();
    assert!(perfect.max_m < 1e-12 && perfect.vector_max_m.unwrap() < 1e-12, "{perfect:?}");
    let turn = Transform::<Base, Base>::from_pose_vector([0.02, 0.0, 0.01, 0.0, 0.0, 0.01]);
    let wrong = EyeToHand { base_from_camera: turn * truth.base_from_camera, ..truth };
    let check = base_distance(&corner(), Some(&wrong), &pairs, &seen).unwrap();
    assert!(check.max_m < 1e-12, "{check:?}");
    // 0.01 rad about z moves the ends of the steps along x and y by 1 mm, and that along z not at all.
    assert!((check.vector_mae_m.unwrap() - 2e-3 / 3.0).abs() < 1e-8, "{check:?}");
    assert!((check.vector_max_m.unwrap() - 1e-3).abs() < 1e-8 && check.per_pair[2].vector_error_m.unwrap() < 1e-12);
}

#[test]
fn a_pure_translation_needs_nothing_of_the_target_on_the_tool() {
    let (seen, mut pairs) = stepped();
    let wrong =
        EyeToHand { tcp_from_target: Transform::from_pose_vector([0.5, 0.1, 0.0, 0.3, 0.0, 1.0]), ..paper_cell() };
    let check = base_distance(&corner(), Some(&wrong), &pairs, &seen).unwrap();
    assert!(check.vector_max_m.unwrap() < 1e-12 && check.per_pair.iter().all(|p| p.pure_translation == Some(true)));
    pairs.truncate(1);
    pairs[0].pose_b = "p4".into();
    let turned = base_distance(&corner(), Some(&paper_cell()), &pairs, &seen).unwrap();
    assert_eq!(turned.per_pair[0].pure_translation, Some(false));
    assert!(turned.vector_mae_m.unwrap() < 1e-12, "{turned:?}");
}

#[test]
fn base_distance_numbers_and_what_is_absent() {
    let (mut seen, mut pairs) = stepped();
    for (pair, error_m) in pairs.iter_mut().zip([1e-3, -2e-3, 4e-3]) {
        pair.truth_m -= error_m;
    }
    pairs.push(DistancePair { name: "lost".into(), pose_a: "p0".into(), pose_b: "nowhere".into(), truth_m: 0.1 });
    for sighting in &mut seen {
        sighting.base_from_tcp = None;
    }
    for solution in [Some(&paper_cell()), None] {
        let check = base_distance(&corner(), solution, &pairs, &seen).unwrap();
        assert_eq!((check.count, check.per_pair[1].pair.as_str()), (3, "0-2"));
        assert!((check.bias_m - 1e-3).abs() < 1e-12 && (check.mae_m - 7e-3 / 3.0).abs() < 1e-12, "{check:?}");
        assert!((check.max_m - 4e-3).abs() < 1e-12 && (check.sigma_m.unwrap() - 3e-3).abs() < 1e-12, "{check:?}");
        let json = serde_json::to_value(&check).unwrap();
        assert!(json.get("vector_mae_m").is_none() && json["per_pair"][0].get("vector_error_m").is_none(), "{json}");
    }
    assert!(base_distance(&corner(), None, &pairs[3..], &seen).is_none());
}

#[test]
fn a_carried_camera_sees_the_corner_in_one_place() {
    let truth = EyeInHand {
        tcp_from_camera: Transform::from_pose_vector([0.02, -0.06, 0.05, 0.1, 0.0, 1.5]),
        base_from_target: Transform::from_pose_vector([0.6, 0.1, 0.0, 3.1, 0.1, 0.0]),
    };
    let pairs = seen_by_carried(&truth, &spread_poses(9, 0.5, 6));
    let without: BTreeMap<_, _> = (0..6).map(|i| (format!("p{i}"), truth)).collect();
    let check = target_in_base(&corner(), &truth, &without, &sightings(&pairs, 6)).unwrap();
    let place = truth.base_from_target * Point::assume_frame(CORNER);
    assert!((Vector3::from(check.mean_m) - place.coords_m()).norm() < 1e-12 && check.max_m < 1e-12, "{check:?}");
    assert_eq!((check.count, check.held_out.unwrap().count, check.leave_one_out.unwrap().count), (9, 3, 6));
    let shift = Transform::<Sensor, Sensor>::from_pose_vector([0.0, 0.0, 0.0, 0.01, 0.0, 0.0]);
    let wrong = EyeInHand { tcp_from_camera: truth.tcp_from_camera * shift, ..truth };
    let check = target_in_base(&corner(), &wrong, &BTreeMap::new(), &sightings(&pairs, 9)).unwrap();
    assert!(check.sigma_m.unwrap() > 1e-3 && check.held_out.is_none() && check.leave_one_out.is_none(), "{check:?}");
    let largest = check.per_pose.iter().map(|p| p.error_m).fold(0.0, f64::max);
    assert!((check.max_m - largest).abs() < 1e-15);
    assert!(target_in_base(&corner(), &truth, &BTreeMap::new(), &[]).is_none());
}
