//! The adjustment against made-up cells of which everything is known.

mod coverage;
mod equations;
mod scene;

use super::robot;
use super::{Adjusted, RobotTie, adjust};
use crate::calibration::hand_eye::{EyeInHand, EyeToHand};
use crate::calibration::result::CalibrationResult;
use crate::calibration::settings::{Carried, HandEyeMethod, Method, Settings};
use crate::calibration::solve::{Origin, solve};
use crate::geometry::{Camera, rotation};
use scene::Scene;

fn close(a: &nalgebra::Isometry3<f64>, b: &nalgebra::Isometry3<f64>, metres: f64, radians: f64) {
    let off = a.inverse() * b;
    assert!(off.translation.vector.norm() < metres && rotation::to_vector(&off.rotation).norm() < radians, "{off}");
}

#[test]
fn without_noise_everything_is_found_exactly() {
    let scene = Scene { shape_m: [40e-6, -30e-6, 20e-6, 0.0, 0.0, 0.0, 0.0], ..Scene::paper().without_noise() };
    let (problem, _) = scene.problem(1);
    let start = scene.start(&problem);
    let mut adjusted = adjust(&problem, &start);
    assert!(adjusted.warnings.is_empty(), "{:?}", adjusted.warnings);
    let refined = adjusted.with_robot::<EyeToHand>(&problem, Camera::Rgb).unwrap().unwrap();
    let found = adjusted.cameras(&start);
    for (camera, truth) in &scene.cameras {
        let pinhole = found[camera].pinhole;
        let off = (pinhole.fx - truth.fx).abs().max((pinhole.cx - truth.cx).abs());
        assert!(off < 1e-4 && found[camera].rms_px < 1e-6, "{pinhole:?}, rms {}", found[camera].rms_px);
        assert!((pinhole.distortion[0] - truth.distortion[0]).abs() < 1e-6, "{pinhole:?}");
    }
    let (pair, _) = adjusted.stereo(&problem).unwrap();
    close(pair.event_from_rgb.iso(), &scene.event_from_rgb, 1e-8, 1e-8);
    close(refined.solution.base_from_camera.iso(), &scene.ends[0], 1e-7, 1e-7);
    close(refined.solution.tcp_from_target.iso(), &scene.ends[1], 1e-7, 1e-7);
    let shape = adjusted.shape(None).unwrap();
    assert!((shape.terms_m[0] - 40e-6).abs() < 1e-9, "{shape:?}");
}

/// The whole solve, from views to bytes: refined where it can be, and the same on any number of threads.
#[test]
fn a_solve_by_the_precise_method_gives_the_same_bytes_on_any_number_of_threads() {
    let scene = Scene { poses: [10, 8], ..Scene::paper() };
    let (problem, _) = scene.problem(2);
    let text = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solve(&problem, Origin::default()).to_json().unwrap())
    };
    let first = text(1);
    let result: CalibrationResult = serde_json::from_str(&first).unwrap();
    let hand_eye = result.hand_eye.unwrap();
    assert!(hand_eye.method == HandEyeMethod::Refined && hand_eye.refined.is_some(), "{hand_eye:?}");
    assert!(hand_eye.panel.contains_key(&HandEyeMethod::Tsai) && hand_eye.uncertainty.is_some(), "{hand_eye:?}");
    assert!(result.cameras.values().all(|c| c.adjusted.is_some()) && result.stereo.unwrap().sigma.is_some());
    assert!(result.uncertainty.len() == 1 && result.warnings.is_empty(), "{:?}", result.warnings);
    assert!(first == text(2) && first == text(8));
}

#[test]
fn the_paper_method_adds_nothing() {
    let (mut problem, _) = Scene { poses: [10, 8], ..Scene::paper() }.problem(2);
    problem.settings = Settings::usual(Method::Paper);
    let text = solve(&problem, Origin::default()).to_json().unwrap();
    assert!(
        ["adjusted", "refined", "display_shape", "uncertainty\": ["].iter().all(|key| !text.contains(key)),
        "{text}"
    );
}

fn adjusted(scene: &Scene, seed: u64) -> Adjusted {
    let (problem, _) = scene.problem(seed);
    adjust(&problem, &scene.start(&problem))
}

#[test]
fn a_bent_display_is_found_and_a_flat_one_stays_flat() {
    let bent = Scene { shape_m: [60e-6, -40e-6, 30e-6, 0.0, 0.0, 0.0, 0.0], poses: [25, 0], ..Scene::paper() };
    let flat = Scene { shape_m: [0.0; 7], ..bent.clone() };
    let runs = 10;
    let mut flats = 0;
    for seed in 0..runs {
        let shape = adjusted(&bent, seed).shape(None).unwrap();
        assert_ne!(shape.model, "flat", "seed {seed}: {shape:?}");
        for (k, (found, sigma)) in shape.terms_m.iter().zip(&shape.sigma_m.sigma).enumerate() {
            assert!((found - bent.shape_m[k]).abs() < 4.5 * sigma, "seed {seed}, term {k}: {shape:?}");
        }
        flats += usize::from(adjusted(&flat, seed).shape(None).unwrap().model == "flat");
    }
    // The rule of one standard error takes a needless model in about 1 of 6 or fewer.
    assert!(flats >= 6, "flat displays stayed flat in {flats} of {runs}");
}

#[test]
fn a_wrong_corner_is_left_out_and_named() {
    let scene = Scene::paper();
    let (mut problem, _) = scene.problem(3);
    let view = problem.poses[5].views.get_mut(&Camera::Event).unwrap();
    let id = view.corners[7].id;
    view.corners[7].px[0] += 10.0;
    let start = scene.start(&problem);
    let adjusted = adjust(&problem, &start);
    let cameras = adjusted.cameras(&start);
    let note = cameras[&Camera::Event].views[&5].note.clone().unwrap_or_default();
    assert!(note.starts_with(&format!("corners left out: {id} (")) && note.contains("px off"), "{note}");
    let lens = adjusted.lens(Camera::Event).unwrap();
    assert_eq!(lens.corners_left_out, 1, "{lens:?}");
    let sigma = &lens.sigma.sigma;
    assert!((cameras[&Camera::Event].pinhole.fx - 2571.0).abs() < 4.5 * sigma.fx, "{lens:?}");
}

#[test]
fn a_view_of_another_board_pose_is_left_out_and_named() {
    let scene = Scene::paper();
    let (mut problem, _) = scene.problem(4);
    let other = problem.poses[2].views[&Camera::Event].clone();
    problem.poses[6].views.insert(Camera::Event, other);
    let start = scene.start(&problem);
    let cameras = adjust(&problem, &start).cameras(&start);
    let fit = &cameras[&Camera::Event].views[&6];
    assert!(fit.rejected.as_ref().is_some_and(|why| why.contains("corners fit within")), "{fit:?}");
    assert!(cameras[&Camera::Rgb].views[&6].rejected.is_none());
}

/// 30 poses give 180 numbers of robot noise: a sigma from 90 of them has a relative error of 7.5 %.
#[test]
fn the_noise_of_the_arm_is_found() {
    let scene = Scene { poses: [10, 30], robot: [0.2e-3, 1e-3], ..Scene::paper() };
    let (problem, _) = scene.problem(5);
    let mut adjusted = adjust(&problem, &scene.start(&problem));
    let facts = adjusted.with_robot::<EyeToHand>(&problem, Camera::Event).unwrap().unwrap().facts;
    assert_eq!(facts.robot_tie, RobotTie::Joint, "{facts:?}");
    assert!((facts.robot_sigma_m / 0.2e-3 - 1.0).abs() < 4.0 * 0.075, "{facts:?}");
    assert!((facts.robot_sigma_rad / 1e-3 - 1.0).abs() < 4.0 * 0.075, "{facts:?}");
}

#[test]
fn an_arm_without_noise_ends_at_the_floor() {
    let scene = Scene { poses: [10, 20], robot: [0.0; 2], ..Scene::paper() };
    let (problem, _) = scene.problem(6);
    let mut adjusted = adjust(&problem, &scene.start(&problem));
    let facts = adjusted.with_robot::<EyeToHand>(&problem, Camera::Rgb).unwrap().unwrap().facts;
    assert!((robot::FLOOR_M..2.5 * robot::FLOOR_M).contains(&facts.robot_sigma_m), "{facts:?}");
}

#[test]
fn one_camera_is_enough() {
    for camera in Camera::BOTH {
        let mut scene = Scene::paper().only(camera);
        scene.poses = [15, 15];
        let (problem, _) = scene.problem(8);
        let start = scene.start(&problem);
        let mut adjusted = adjust(&problem, &start);
        let refined = adjusted.with_robot::<EyeToHand>(&problem, camera).unwrap().unwrap();
        let (found, sigma) = (adjusted.cameras(&start)[&camera].pinhole, adjusted.lens(camera).unwrap().sigma.sigma);
        assert!((found.fx - scene.cameras[&camera].fx).abs() < 4.5 * sigma.fx, "{found:?} {sigma:?}");
        assert!(adjusted.stereo(&problem).is_none());
        let rgb_from_camera =
            if camera == Camera::Rgb { nalgebra::Isometry3::identity() } else { scene.event_from_rgb.inverse() };
        let off = refined.solution.base_from_camera.iso().translation.vector
            - (scene.ends[0] * rgb_from_camera).translation.vector;
        for k in 0..3 {
            let sigma = refined.facts.camera.sigma.translation_m[k];
            assert!(off[k].abs() < 4.5 * sigma && sigma < 0.02, "{off} {:?}", refined.facts);
        }
    }
}

#[test]
fn carried_cameras_are_found_by_the_same_code() {
    let scene = Scene { carried: Carried::Cameras, poses: [12, 20], ..Scene::paper() };
    let scene = Scene { ends: [scene.ends[0], scene.ends[1]], ..scene };
    let (problem, _) = scene.problem(9);
    let mut adjusted = adjust(&problem, &scene.start(&problem));
    let refined = adjusted.with_robot::<EyeInHand>(&problem, Camera::Event).unwrap().unwrap();
    let truth = scene.ends[1] * scene.event_from_rgb.inverse();
    let off = refined.solution.tcp_from_camera.iso().translation.vector - truth.translation.vector;
    let target = refined.solution.base_from_target.iso().translation.vector - scene.ends[0].translation.vector;
    for k in 0..3 {
        let sigmas = (refined.facts.camera.sigma.translation_m[k], refined.facts.target.sigma.translation_m[k]);
        assert!(
            off[k].abs() < 4.5 * sigmas.0 && target[k].abs() < 4.5 * sigmas.1,
            "{off} {target} {:?}",
            refined.facts
        );
        assert!(sigmas.0 < 0.02 && sigmas.1 < 0.02, "{sigmas:?}");
    }
    assert_eq!(refined.without.len(), 20);
}

/// An arm whose scale is off by 1 %: its noise is seen to be large, and the cameras stay where the corners have them.
#[test]
fn a_bad_arm_does_not_pull_at_the_cameras() {
    let scene = Scene { poses: [15, 20], robot: [0.05e-3, 0.1e-3], ..Scene::paper() };
    let (mut problem, _) = scene.problem(10);
    for pose in &mut problem.poses {
        let stretched = pose.base_from_tcp.map(|t| {
            let [x, y, z] = t.translation_m();
            crate::geometry::Transform::from_parts([1.01 * x, 1.01 * y, 1.01 * z], t.rotation())
        });
        pose.base_from_tcp = stretched;
    }
    let start = scene.start(&problem);
    let mut adjusted = adjust(&problem, &start);
    adjusted.with_robot::<EyeToHand>(&problem, Camera::Event).unwrap().unwrap();
    let cameras = adjusted.cameras(&start);
    for (camera, truth) in &scene.cameras {
        let sigma = adjusted.lens(*camera).unwrap().sigma.sigma;
        assert!(
            (cameras[camera].pinhole.fx - truth.fx).abs() < 4.5 * sigma.fx,
            "{:?} {sigma:?}",
            cameras[camera].pinhole
        );
    }
}
