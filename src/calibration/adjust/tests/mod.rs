//! The adjustment against made-up cells of which everything is known.

mod scene;

use nalgebra::Vector3;

use super::adjust;
use crate::calibration::adjust::shape::TERMS;
use crate::calibration::hand_eye::EyeToHand;
use crate::geometry::{Camera, rotation};
use scene::Scene;

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
    let off = pair.event_from_rgb.iso().inverse() * scene.event_from_rgb;
    assert!(off.translation.vector.norm() < 1e-9 && rotation::to_vector(&off.rotation).norm() < 1e-8, "{off}");
    let off = refined.solution.base_from_camera.iso().inverse() * scene.ends[0];
    assert!(off.translation.vector.norm() < 1e-8 && rotation::to_vector(&off.rotation).norm() < 1e-8, "{off}");
    let shape = adjusted.shape(None).unwrap();
    assert!((shape.terms_m[0] - 40e-6).abs() < 1e-9, "{shape:?}");
}

#[test]
fn timed() {
    let scene = Scene { poses: [39, 34], ..Scene::paper() };
    let (problem, _) = scene.problem(7);
    let start = scene.start(&problem);
    let t = std::time::Instant::now();
    let mut adjusted = adjust(&problem, &start);
    eprintln!("adjust {:?}", t.elapsed());
    let refined = adjusted.with_robot::<EyeToHand>(&problem, Camera::Event).unwrap().unwrap();
    eprintln!("all {:?}", t.elapsed());
    eprintln!("{:#?}", refined.facts);
    eprintln!("{:?} {:?}", adjusted.lens(Camera::Rgb), adjusted.lens(Camera::Event));
    eprintln!("{:?}", adjusted.shape(None));
    eprintln!("{:?}", adjusted.warnings);
    let _ = (Vector3::<f64>::zeros(), TERMS);
}
