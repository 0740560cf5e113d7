//! The simulated operator: holds the display before both cameras, moves it smoothly to a random place, pauses, and on.
//!
//! There is no controller here: time passes when somebody rests.

use std::sync::Arc;
use std::time::Duration;

use nalgebra::UnitQuaternion;
use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::cell::{SimError, SimTruth, whole_rig};
use super::rig::{Rig, SimEventCamera, SimFrameCamera, Whereabouts};
use super::ur::SimClock;
use crate::config::Cell;
use crate::devices::{EventCamera, FrameCamera};
use crate::geometry::{Base, Flange, Rgb, Target, Transform, rotation};

/// Places of the path; then it begins again.
const PLACES: usize = 400;
/// Length of a move and of the pause after it, s.
const MOVE_S: f64 = 1.2;
const PAUSE_S: f64 = 2.0;
/// Tremor of the hands: amplitude, m, and frequency, Hz (physiological tremor has 8 to 12 Hz).
const TREMOR_M: f64 = 30e-6;
const TREMOR_HZ: f64 = 9.3;
/// Tilts reach this far, degrees: about x and y, and about the line of sight.
const TILT_DEG: f64 = 26.0;
const ROLL_DEG: f64 = 15.0;
/// The board fills this share of the image width at its middle distance, and the distances around it.
const FILLS: f64 = 0.42;
const DISTANCES: [f64; 2] = [0.92, 1.2];
/// A rest of whoever waits, s of simulated time.
pub(super) const REST_S: f64 = 0.005;

/// Where the display is held, as a function of time.
#[derive(Debug, Clone)]
pub struct HandPath {
    places: Vec<Transform<Rgb, Target>>,
}

impl HandPath {
    /// Places that both cameras see, by the nominal cell.
    fn draw(cell: &Cell, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed ^ 0x4a4d_0001);
        let places = (0..PLACES).map(|_| place(cell, &mut random)).collect();
        Self { places }
    }

    /// The display before the frame camera at a simulated time, s.
    pub fn rgb_from_target_at(&self, at_s: f64) -> Option<Transform<Rgb, Target>> {
        let (leg, into_s) = ((at_s / (MOVE_S + PAUSE_S)).floor(), at_s.rem_euclid(MOVE_S + PAUSE_S));
        let index = if leg.is_finite() && leg >= 0.0 { leg as usize } else { return None };
        let at = |i: usize| self.places.get(i % self.places.len().max(1));
        let (from, to) = (at(index)?, at(index + 1)?);
        let part = (into_s / MOVE_S).min(1.0);
        // Begins and ends at rest.
        let smooth = part * part * (3.0 - 2.0 * part);
        let [a, b] = [from.translation_m(), to.translation_m()];
        let tremor_m = TREMOR_M * (std::f64::consts::TAU * TREMOR_HZ * at_s).sin();
        let translation_m = std::array::from_fn(|i| a[i] + smooth * (b[i] - a[i]) + tremor_m);
        Some(Transform::from_parts(translation_m, from.rotation().slerp(&to.rotation(), smooth)))
    }

    /// The same for cameras that know only an arm: the hand is the flange, the frame camera the base.
    pub(super) fn base_from_flange_at(&self, at_s: f64) -> Option<Transform<Base, Flange>> {
        self.rgb_from_target_at(at_s).map(|held| Transform::assume_frames(*held.iso()))
    }
}

fn place(cell: &Cell, random: &mut Pcg64) -> Transform<Rgb, Target> {
    let mut within = |half: f64| random.random_range(-half..=half);
    let board = &cell.board;
    let [board_x_m, board_y_m] = [board.squares_x, board.squares_y].map(|n| f64::from(n) * board.square_m);
    let (focal_px, width_px) =
        cell.rgb.as_ref().map_or((2667.0, 1380.0), |c| (c.focal_length_m / c.pixel_pitch_m, f64::from(c.width)));
    let middle_m = focal_px * board_x_m / (FILLS * width_px);
    let tilt = [within(TILT_DEG), within(TILT_DEG), within(ROLL_DEG)].map(f64::to_radians);
    // Half way between the cameras, as far aside as both still see it whole.
    let between_m = cell.nominal.event_from_rgb.map_or([0.0; 3], |t| t.translation_m().map(|v| -0.5 * v));
    let aside_m = [within(0.3 * board_x_m), within(0.25 * board_y_m)];
    let distance_m = middle_m * (0.5 * (DISTANCES[0] + DISTANCES[1]) + within(0.5 * (DISTANCES[1] - DISTANCES[0])));
    let rotation: UnitQuaternion<f64> = rotation::from_vector(tilt);
    let centre =
        Transform::<Rgb, Rgb>::from_parts([between_m[0] + aside_m[0], between_m[1] + aside_m[1], distance_m], rotation);
    let corner =
        Transform::<Rgb, Target>::from_parts([-0.5 * board_x_m, -0.5 * board_y_m, 0.0], UnitQuaternion::identity());
    centre * corner
}

/// A simulated cell without a robot.
pub struct SimHand {
    /// Simulated time.
    pub clock: SimClock,
    /// What is true; for tests only.
    pub truth: SimTruth,
    rig: Arc<Rig>,
    has: [bool; 2],
    images_per_pose: u32,
    time_scale: f64,
}

impl SimHand {
    /// Draws the cell; `time_scale` simulated seconds a real second, infinity: as fast as it goes.
    pub fn start(cell: &Cell, seed: Option<u64>, time_scale: f64) -> Result<Self, SimError> {
        let seed = seed.or(cell.sim.as_ref().map(|s| s.seed)).unwrap_or(1);
        let clock = SimClock::default();
        let path = HandPath::draw(cell, seed);
        let (rig, truth) = whole_rig(cell, seed, Whereabouts::Hand(path), clock.clone())?;
        let has = [cell.rgb.is_some(), cell.event.is_some()];
        Ok(Self { clock, truth, rig: Arc::new(rig), has, images_per_pose: cell.images_per_pose, time_scale })
    }

    /// The frame camera, if the cell has one.
    pub fn frame(&self) -> Option<Box<dyn FrameCamera>> {
        self.has[0].then(|| Box::new(SimFrameCamera::new(Arc::clone(&self.rig))) as _)
    }

    /// The event camera, if the cell has one.
    pub fn event(&self) -> Option<Box<dyn EventCamera>> {
        let alone = (!self.has[0]).then_some(self.images_per_pose);
        self.has[1].then(|| Box::new(SimEventCamera::new(Arc::clone(&self.rig), alone)) as _)
    }

    /// Lets simulated time pass whenever somebody waits.
    pub fn rest(&self) -> Box<dyn FnMut()> {
        let (clock, time_scale) = (self.clock.clone(), self.time_scale);
        Box::new(move || {
            clock.advance(REST_S);
            if time_scale.is_finite() {
                pause(REST_S / time_scale);
            }
        })
    }
}

#[expect(clippy::disallowed_methods, reason = "simulated time is tied to real time here")]
pub(super) fn pause(seconds: f64) {
    std::thread::sleep(Duration::from_secs_f64(seconds.clamp(0.0, 1.0)));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path() -> HandPath {
        let turn = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3);
        let places = [[0.0, 0.0, 0.3], [0.03, 0.01, 0.35]];
        HandPath { places: places.map(|t| Transform::from_parts(t, turn)).into() }
    }

    #[test]
    fn the_display_rests_between_moves_but_for_the_tremor() {
        let path = path();
        let at = |s: f64| path.rgb_from_target_at(s).unwrap().translation_m();
        for s in [MOVE_S, MOVE_S + 0.7, MOVE_S + PAUSE_S - 1e-6] {
            let off_m = (0..3).map(|i| (at(s)[i] - [0.03, 0.01, 0.35][i]).abs()).fold(0.0, f64::max);
            assert!(off_m <= TREMOR_M * 1.0001, "{s}: {off_m}");
        }
        assert!((at(0.5 * MOVE_S)[2] - 0.325).abs() < 2.0 * TREMOR_M, "half way at half time");
    }

    #[test]
    fn no_time_before_the_beginning() {
        for odd in [-1.0, f64::NAN, f64::NEG_INFINITY] {
            assert!(path().rgb_from_target_at(odd).is_none(), "{odd}");
        }
    }
}
