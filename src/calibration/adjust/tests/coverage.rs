//! Whether stated uncertainties are true: many small cells, and how often the truth lies within 1.96 sigma.

use rayon::prelude::*;

use super::scene::Scene;
use crate::calibration::adjust::adjust;
use crate::calibration::hand_eye::EyeToHand;
use crate::geometry::Camera;

const RUNS: u64 = 200;

/// Errors over their sigma, formal and the larger of both, of what one made-up session gives.
fn errors(scene: &Scene, seed: u64) -> Vec<[f64; 2]> {
    let (problem, _) = scene.problem(seed);
    let start = scene.start(&problem);
    let mut adjusted = adjust(&problem, &start);
    let refined = adjusted.with_robot::<EyeToHand>(&problem, Camera::Rgb).unwrap().unwrap();
    let cameras = adjusted.cameras(&start);
    let mut all = Vec::new();
    for (camera, truth) in &scene.cameras {
        let (p, s) = (cameras[camera].pinhole, adjusted.lens(*camera).unwrap().sigma);
        all.push([(p.fx - truth.fx) / s.formal.fx, (p.fx - truth.fx) / s.sigma.fx]);
        all.push([(p.fy - truth.fy) / s.formal.fy, (p.fy - truth.fy) / s.sigma.fy]);
        all.push([(p.cx - truth.cx) / s.formal.cx, (p.cx - truth.cx) / s.sigma.cx]);
        all.push([(p.cy - truth.cy) / s.formal.cy, (p.cy - truth.cy) / s.sigma.cy]);
    }
    let (pair, sigma) = adjusted.stereo(&problem).unwrap();
    let off = pair.event_from_rgb.iso().translation.vector - scene.event_from_rgb.translation.vector;
    let both = |k: usize, off: f64| [off / sigma.formal.translation_m[k], off / sigma.sigma.translation_m[k]];
    all.extend((0..3).map(|k| both(k, off[k])));
    let off = refined.solution.base_from_camera.iso().translation.vector - scene.ends[0].translation.vector;
    let sigma = &refined.facts.camera;
    let both = |k: usize, off: f64| [off / sigma.formal.translation_m[k], off / sigma.sigma.translation_m[k]];
    all.extend((0..3).map(|k| both(k, off[k])));
    all
}

/// 95 % lie within 1.96 sigma; 2800 numbers, of which those of one run hang together, are good to about 1 %.
#[test]
fn the_truth_lies_within_the_stated_interval_in_95_of_100() {
    let mut scene = Scene { poses: [8, 10], ..Scene::paper() };
    // Lenses of one term, so that every run has the same unknowns.
    scene.cameras.values_mut().for_each(|c| c.distortion = [-0.2, 0.0, 0.0, 0.0, 0.0]);
    let runs: Vec<Vec<[f64; 2]>> = (0..RUNS).into_par_iter().map(|seed| errors(&scene, 1000 + seed)).collect();
    let numbers = runs[0].len();
    let within = |which: usize, k: usize| runs.iter().filter(|r| r[k][which].abs() < 1.96).count() as f64;
    let share = |which: usize| (0..numbers).map(|k| within(which, k)).sum::<f64>() / (numbers as f64 * RUNS as f64);
    let each: Vec<f64> = (0..numbers).map(|k| within(1, k) / RUNS as f64).collect();
    eprintln!("within 1.96 sigma: formal {:.3}, larger of both {:.3}, each {each:?}", share(0), share(1));
    assert!((0.91..=0.98).contains(&share(1)), "{each:?}");
    // A single number of 200 runs: four standard errors of 0.0154.
    assert!(each.iter().all(|c| *c > 0.95 - 4.0 * 0.0154), "{each:?}");
}
