//! The scene against geometry and statistics that do not come from its own renderer.

use nalgebra::{Matrix2, UnitQuaternion, Vector2};

use super::*;
use crate::geometry::{self, rotation};

/// A checkerboard: black where row + column is even, as ChArUco boards are.
fn checkerboard(px_per_square: usize) -> GrayImage {
    let mut image = GrayImage::filled(7 * px_per_square, 5 * px_per_square, 255);
    for (i, pixel) in image.pixels.iter_mut().enumerate() {
        let (x, y) = (i % (7 * px_per_square) / px_per_square, i / (7 * px_per_square) / px_per_square);
        *pixel = if (x + y).is_multiple_of(2) { 0 } else { 255 };
    }
    image
}

pub(super) fn board() -> Board {
    Board { squares_x: 7, squares_y: 5, square_m: 0.0088, marker_m: 0.00704, dictionary: "DICT_4X4_50".into() }
}

/// Cameras of half the paper's resolution: squares are 40 px wide.
pub(super) fn spec() -> SceneSpec {
    let optics = Optics { distortion: [-0.2, 0.3, 2e-4, -1e-4, 0.0], ..Optics::nominal(480, 360, 1300.0, 0.9) };
    SceneSpec {
        board: board(),
        pattern: checkerboard(30),
        alpha: 0.6,
        cycle_hz: 15.0,
        display: DisplaySpec::default(),
        rgb: Some((optics.clone(), FrameSpec::default())),
        event: Some((optics, EventSpec::default())),
        seed: 11,
    }
}

/// No noise, no blur, no glare, no bow; a pixel fires when about half of it is black.
pub(super) fn plain() -> SceneSpec {
    let mut spec = spec();
    let display = DisplaySpec { bow_m: 0.0, glare: 0.0, ..DisplaySpec::default() };
    let event = EventSpec {
        threshold_mismatch: 0.0,
        high_pass_gain: 1.0,
        dark_cd_m2: 0.1,
        background_hz: 0.0,
        hot_pixels: 0,
        ..EventSpec::default()
    };
    let optics = Optics { psf_sigma_px: 0.0, ..spec.event.unwrap().0 };
    spec.event = Some((optics, event));
    SceneSpec { display, ..spec }
}

/// The board's centre near the axis at 0.29 m, turned about its centre.
pub(super) fn pose<C>(turn_rad: [f64; 3], shift_m: [f64; 2]) -> Transform<C, Target> {
    let [x, y, _] = board().centre().xyz_m();
    let centre = Transform::<Target, Target>::from_parts([-x, -y, 0.0], UnitQuaternion::identity());
    Transform::from_parts([shift_m[0], shift_m[1], 0.29], rotation::from_vector(turn_rad)) * centre
}

/// Finds the saddle near `start`: the point that every gradient around it is square to.
fn saddle(light: impl Fn(i64, i64) -> f64, start: [f64; 2]) -> [f64; 2] {
    let mut at = Vector2::from(start);
    for _ in 0..20 {
        let (mut sum, mut weighted) = (Matrix2::zeros(), Vector2::zeros());
        let (x0, y0) = (at.x.round() as i64, at.y.round() as i64);
        for (x, y) in (-6..=6).flat_map(|j| (-6..=6).map(move |i| (x0 + i, y0 + j))) {
            let point = Vector2::new(x as f64, y as f64);
            let gradient = Vector2::new(light(x + 1, y) - light(x - 1, y), light(x, y + 1) - light(x, y - 1));
            let outer = gradient * gradient.transpose() * (-(point - at).norm_squared() / 10.0).exp();
            sum += outer;
            weighted += outer * point;
        }
        at = sum.try_inverse().unwrap() * weighted;
    }
    at.into()
}

#[test]
fn corners_in_the_image_are_where_the_projection_says() {
    let display = DisplaySpec { bow_m: 200e-6, ..DisplaySpec::default() };
    let scene = Scene::new(SceneSpec { display, ..spec() }).unwrap();
    let camera = scene.rgb.as_ref().unwrap();
    for (turn, shift) in [
        ([0.0; 3], [0.0; 2]),
        ([0.0; 3], [0.37e-4, -0.81e-4]),
        ([0.0, 0.0, 0.2], [0.004, 0.002]),
        ([0.4, 0.0, 0.1], [0.0; 2]),
        ([-0.2, -0.45, 1.5], [-0.003, 0.001]),
    ] {
        let rgb_from_target = pose::<Rgb>(turn, shift);
        let seen = Rendered::new(&scene.panel, &camera.lens, &rgb_from_target);
        let light = |x: i64, y: i64| f64::from(seen.states(x as usize, y as usize)[0]);
        let mut bias = Vector2::zeros();
        for id in 0..24 {
            let truth = scene.project_rgb(&rgb_from_target, board().corner(id).unwrap()).unwrap();
            let error = Vector2::from(saddle(light, truth)) - Vector2::from(truth);
            assert!(error.norm() < 0.025, "{turn:?} corner {id}: {error:?} px");
            bias += error / 24.0;
        }
        assert!(bias.norm() < 0.005, "{turn:?}: {bias:?} px");
    }
}

#[test]
fn the_bow_moves_corners_at_a_tilt_by_what_it_should() {
    let at = |bow_m: f64| {
        let display = DisplaySpec { bow_m, ..DisplaySpec::default() };
        let scene = Scene::new(SceneSpec { display, ..spec() }).unwrap();
        let corner = |id| scene.project_rgb(&pose([0.0, 0.5, 0.0], [0.0; 2]), board().corner(id).unwrap()).unwrap();
        (0..24).map(corner).collect::<Vec<_>>()
    };
    let (flat, bent) = (at(0.0), at(80e-6));
    let largest = flat.iter().zip(&bent).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
    // 80 um over the board, about half of it over the inner corners, seen at sin 0.5 and 4.5 px/mm.
    assert!((0.02..0.17).contains(&largest), "{largest} px");
}

#[test]
fn an_exposure_over_whole_cycles_is_the_mean_of_both_states() {
    let mut spec = plain();
    spec.display = DisplaySpec { fall_s: 0.003, rise_s: 0.003, ..spec.display };
    spec.rgb.as_mut().unwrap().1 = FrameSpec { read_noise_dn: 0.0, electrons_per_dn: 1e6, prnu: 0.0, white_dn: 200.0 };
    let scene = Scene::new(spec).unwrap();
    let rgb_from_target = pose([0.1, 0.2, 0.0], [0.0; 2]);
    let exposed = scene.expose(&rgb_from_target, 0.777, 3.0 / 15.0);
    let states = [State::Pattern, State::Blended].map(|s| scene.state_rgb(&rgb_from_target, s));
    for i in 0..exposed.pixels.len() {
        let [dark, bright] = [&states[0], &states[1]].map(|s| f64::from(s.pixels[i]));
        assert!((f64::from(exposed.pixels[i]) - (dark + bright) / 2.0).abs() <= 1.51, "pixel {i}");
    }
    // A black square: 0.6 ^ 2.2 of white in the blended state, next to nothing in the pattern.
    let [x, y] = scene.project_rgb(&rgb_from_target, Point::assume_frame([0.0132, 0.0132, 0.0])).unwrap();
    let [dark, bright] = [0, 1].map(|s: usize| f64::from(states[s].at(x as usize, y as usize)));
    assert!((1.0..4.0).contains(&dark) && (60.0..68.0).contains(&bright), "{dark} {bright}");
}

#[test]
fn the_noise_of_a_frame_is_shot_read_and_fixed_pattern_noise() {
    let mut spec = spec();
    spec.display.glare = 0.0;
    spec.rgb.as_mut().unwrap().1.white_dn = 200.0;
    let scene = Scene::new(spec).unwrap();
    let rgb_from_target = pose([0.0; 3], [0.0; 2]);
    let image = scene.expose(&rgb_from_target, 0.3, 0.1);
    let clean = scene.state_rgb(&rgb_from_target, State::Pattern);
    let white: Vec<usize> = (0..clean.pixels.len()).filter(|i| clean.pixels[*i] >= 198).collect();
    let values = || white.iter().map(|i| f64::from(image.pixels[*i]));
    let mean = values().sum::<f64>() / white.len() as f64;
    let variance = values().map(|v| (v - mean).powi(2)).sum::<f64>() / white.len() as f64;
    let expected = mean / 9.0 + 0.8 * 0.8 + (0.006 * mean).powi(2) + 1.0 / 12.0;
    assert!(white.len() > 10_000 && (196.0..202.0).contains(&mean), "{} {mean}", white.len());
    assert!((variance / expected - 1.0).abs() < 0.05, "{variance} instead of {expected} DN2");
}

/// Area of a projected quadrilateral, px2.
fn area_px2(corners: &[[f64; 2]]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>().abs() / 2.0
}

#[test]
fn every_black_pixel_fires_once_a_transition_with_alternating_sign() {
    let scene = Scene::new(plain()).unwrap();
    let event_from_target = pose::<geometry::Event>([0.25, -0.3, 0.15], [0.0; 2]);
    let corner = |x: i32, y: i32| {
        let at = [f64::from(x) * 0.0088, f64::from(y) * 0.0088, 0.0];
        scene.project_event(&event_from_target, Point::assume_frame(at)).unwrap()
    };
    let squares = (0..5).flat_map(|y| (0..7).map(move |x| (x, y))).filter(|(x, y)| (x + y) % 2 == 0);
    let quads = squares.map(|(x, y)| [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)]);
    let black_px: f64 = quads.map(|q| area_px2(&q)).sum();
    // 20 transitions; between the bursts nothing happens for 15 ms.
    let events = scene.events(&event_from_target, 2.0, 2.0 + 20.0 / 30.0);
    let bursts: Vec<&[Event]> = events.chunk_by(|a, b| b.t_us - a.t_us < 5_000).collect();
    assert!((20..=21).contains(&bursts.len()), "{} bursts", bursts.len());
    for pair in bursts[1..bursts.len() - 1].windows(2) {
        assert!(pair[0].iter().all(|e| e.on == pair[0][0].on) && pair[0][0].on != pair[1][0].on);
        let mut places: Vec<_> = pair[0].iter().map(|e| (e.y, e.x)).collect();
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), pair[0].len(), "a pixel fired twice");
        assert!((places.len() as f64 / black_px - 1.0).abs() < 0.01, "{} of {black_px} px", places.len());
    }
}

#[test]
fn white_squares_fire_only_noise() {
    let mut spec = spec();
    spec.event.as_mut().unwrap().1.hot_pixels = 0;
    let scene = Scene::new(spec).unwrap();
    let event_from_target = pose::<geometry::Event>([0.0; 3], [0.0; 2]);
    let centre = Point::assume_frame([1.5 * 0.0088, 0.5 * 0.0088, 0.0]);
    let [x, y] = scene.project_event(&event_from_target, centre).unwrap();
    let inside = |e: &&Event| (f64::from(e.x) - x).abs() <= 12.0 && (f64::from(e.y) - y).abs() <= 12.0;
    let events = scene.events(&event_from_target, 0.0, 2.0);
    let found = events.iter().filter(inside).count() as f64;
    let expected: f64 = 25.0 * 25.0 * 0.3 * 2.0;
    assert!((found - expected).abs() < 5.0 * expected.sqrt(), "{found} instead of {expected}");
    let on = events.iter().filter(inside).filter(|e| e.on).count() as f64;
    assert!((on - found / 2.0).abs() < 2.5 * found.sqrt(), "{on} of {found} ON");
}

#[test]
fn a_step_between_the_thresholds_fires_one_sign_only() {
    let mut spec = plain();
    spec.event.as_mut().unwrap().1.threshold_on = 1.0;
    spec.event.as_mut().unwrap().1.threshold_off = 4.0;
    let scene = Scene::new(spec).unwrap();
    let events = scene.events(&pose([0.0; 3], [0.0; 2]), 0.0, 0.2);
    assert!(events.len() > 10_000 && events.iter().all(|e| e.on));
}

#[test]
fn lower_rows_of_the_display_change_later() {
    let scene = Scene::new(plain()).unwrap();
    let event_from_target = pose::<geometry::Event>([0.0; 3], [0.0; 2]);
    let events = scene.events(&event_from_target, 0.0, 1.0);
    let bursts: Vec<&[Event]> = events.chunk_by(|a, b| b.t_us - a.t_us < 5_000).collect();
    let at = |y_m: f64, burst: &[Event]| {
        let [_, y] = scene.project_event(&event_from_target, Point::assume_frame([0.03, y_m, 0.0])).unwrap();
        let row: Vec<f64> =
            burst.iter().filter(|e| (f64::from(e.y) - y).abs() < 3.0).map(|e| e.t_us as f64 * 1e-6).collect();
        row.iter().sum::<f64>() / row.len() as f64
    };
    let bursts = &bursts[1..bursts.len() - 1];
    let delay = bursts.iter().map(|b| at(0.040, b) - at(0.004, b)).sum::<f64>() / bursts.len() as f64;
    // 36 mm of the 44 + 8.8 mm that are scanned in 15 ms.
    assert!((delay - 0.015 * 36.0 / 52.8).abs() < 1e-4, "{delay} s");
}

#[test]
fn windows_that_meet_have_the_events_of_one_window() {
    let scene = Scene::new(spec()).unwrap();
    let event_from_target = pose([0.1, 0.0, 0.0], [0.0; 2]);
    let whole = scene.events(&event_from_target, 3.0, 3.1);
    let mut parts = scene.events(&event_from_target, 3.0, 3.0371);
    parts.extend(scene.events(&event_from_target, 3.0371, 3.1));
    assert!(whole == parts && whole.is_sorted());
    assert!(whole.iter().all(|e| (3_000_000..3_100_000).contains(&e.t_us)));
}

#[test]
fn a_seed_gives_the_same_on_any_number_of_threads_and_another_seed_does_not() {
    let run = |seed: u64, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let scene = Scene::new(SceneSpec { seed, ..spec() }).unwrap();
            let turn = [0.1, -0.2, 0.05];
            (scene.expose(&pose(turn, [0.0; 2]), 0.5, 0.1), scene.events(&pose(turn, [0.0; 2]), 0.5, 0.6))
        })
    };
    let (image, events) = run(1, 1);
    assert!((image.clone(), events.clone()) == run(1, 3));
    let (other_image, other_events) = run(2, 1);
    assert!(image != other_image && events != other_events);
}

#[test]
fn a_display_that_is_not_in_sight_gives_background_and_noise() {
    let scene = Scene::new(spec()).unwrap();
    let behind = [[0.0, 3.1, 0.0], [0.0, std::f64::consts::FRAC_PI_2, 0.0], [f64::NAN, 0.0, 0.0]];
    for turn in behind {
        let image = scene.expose(&pose(turn, [0.0; 2]), 0.0, 0.1);
        assert!(image.pixels.iter().all(|v| *v < 20), "{turn:?}");
        // 480 x 360 pixels at 0.3 Hz and 40 at 100 Hz, for 0.1 s.
        assert!((4_800..6_400).contains(&scene.events(&pose(turn, [0.0; 2]), 0.0, 0.1).len()), "{turn:?}");
    }
    assert!(scene.project_rgb(&pose([0.0; 3], [1.0, 0.0]), board().centre()).is_none());
    assert!(scene.events(&pose([0.0; 3], [0.0; 2]), 0.0, f64::INFINITY).is_empty());
    assert!(scene.events(&pose([0.0; 3], [0.0; 2]), f64::NAN, 1.0).is_empty());
}

#[test]
fn impossible_scenes_are_refused_and_missing_cameras_are_blind() {
    let refused = |spec: SceneSpec| Scene::new(spec).unwrap_err().to_string();
    assert!(refused(SceneSpec { alpha: f64::NAN, ..spec() }).starts_with("alpha of the simulated cell is NaN"));
    assert!(refused(SceneSpec { pattern: GrayImage::filled(211, 150, 0), ..spec() }).contains("211 x 150 px"));
    assert!(refused(SceneSpec { pattern: GrayImage::filled(0, 0, 0), ..spec() }).contains("0 x 0 px"));
    assert!(refused(SceneSpec { cycle_hz: 0.0, ..spec() }).starts_with("cycle_hz"));
    let blind = Scene::new(SceneSpec { rgb: None, event: None, ..spec() }).unwrap();
    assert!(blind.expose(&pose([0.0; 3], [0.0; 2]), 0.0, 0.1).pixels.is_empty());
    assert!(blind.events(&pose([0.0; 3], [0.0; 2]), 0.0, 0.1).is_empty());
}
