//! The physics of a blinking ChArUco display seen by a frame camera and an event camera.
//!
//! Pure computation: no files, no clocks; the same seed gives the same light, noise and events on any number
//! of threads and in any order of calls. Uses `geometry`, `board`, `image` and `events`. Start at [`Scene`].
//!
//! Left out on purpose: colour, the structure of display pixels, motion during a capture.

mod backlight;
mod blink;
mod blur;
mod flicker;
mod frame;
mod noise;
mod occlusion;
mod optics;
mod overlay;
mod panel;
mod pixels;
mod render;
mod spec;
#[cfg(test)]
mod statistics;
#[cfg(test)]
mod tests;
mod texture;

pub use optics::Optics;
pub use overlay::{Occluder, Spotlight};
pub use spec::{DisplaySpec, EventSpec, FrameSpec};

use self::backlight::Backlight;
use self::blink::Blink;
use self::frame::FrameCamera;
use self::optics::Lens;
use self::panel::Panel;
use self::pixels::EventSensor;
use self::render::{Rendered, Renders};
use self::spec::in_range;
use self::texture::Texture;
use crate::board::{Board, BoardError};
use crate::events::Event;
use crate::geometry::{self, Point, Rgb, Target, Transform};
use crate::image::GrayImage;

/// Everything that defines a scene but the poses.
#[derive(Debug, Clone)]
pub struct SceneSpec {
    /// The board on the display.
    pub board: Board,
    /// Code values of the display over exactly the board's outer area, whole pixels a square.
    pub pattern: GrayImage,
    /// How far the second state is blended with white, 0 to 1.
    pub alpha: f64,
    /// Full cycles (pattern, blended) a second, Hz.
    pub cycle_hz: f64,
    /// The display.
    pub display: DisplaySpec,
    /// The frame camera, where there is one.
    pub rgb: Option<(Optics, FrameSpec)>,
    /// The event camera, where there is one.
    pub event: Option<(Optics, EventSpec)>,
    /// Phase, shape, mismatch and noise follow from it.
    pub seed: u64,
}

/// Why a scene cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A number outside its range.
    #[error("{name} of the simulated cell is {value}, outside {low} to {high}")]
    Value {
        /// Which.
        name: &'static str,
        /// What was found.
        value: f64,
        /// The smallest allowed.
        low: f64,
        /// The largest allowed.
        high: f64,
    },
    /// The pattern does not fit the board.
    #[error(
        "the pattern is {width} x {height} px with {bytes} bytes, not the same whole number of px for each of {squares_x} x {squares_y} squares; draw it without a margin"
    )]
    Pattern {
        /// Columns found.
        width: usize,
        /// Rows found.
        height: usize,
        /// Bytes found.
        bytes: usize,
        /// Squares of the board along x.
        squares_x: u32,
        /// Squares of the board along y.
        squares_y: u32,
    },
    /// The distortion is no lens.
    #[error("the distortion folds the image at pixel {px:?}; use smaller k1, k2, k3")]
    Lens {
        /// Column and row.
        px: [f64; 2],
    },
    /// The board is none.
    #[error(transparent)]
    Board(#[from] BoardError),
}

/// One of the two states of the display.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// The pattern itself.
    Pattern,
    /// The pattern blended with white.
    Blended,
}

/// A blinking display and the cameras that look at it. Times are seconds of the host's clock.
#[derive(Debug)]
pub struct Scene {
    panel: Panel,
    blink: Blink,
    backlight: Option<Backlight>,
    rgb: Option<FrameCamera>,
    event: Option<EventSensor>,
    /// What each camera saw last: a camera that stands still is rendered once.
    renders: [Renders; 2],
}

impl Scene {
    /// Checks every number and prepares what does not depend on poses: about 0.2 s for two cameras.
    pub fn new(spec: SceneSpec) -> Result<Self, SceneError> {
        spec.board.check()?;
        check_pattern(&spec.board, &spec.pattern)?;
        in_range("alpha", spec.alpha, 0.0, 1.0)?;
        in_range("cycle_hz", spec.cycle_hz, 0.1, 120.0)?;
        spec.display.check()?;
        let SceneSpec { board, pattern, alpha, cycle_hz, display, rgb, event, seed } = spec;
        let display = display.at_its_brightness();
        let white_cd_m2 = display.white_cd_m2 + display.ambient_cd_m2;
        Ok(Self {
            blink: Blink::new(&display, cycle_hz, seed),
            backlight: Backlight::new(&display),
            renders: Default::default(),
            rgb: rgb.map(|(optics, spec)| FrameCamera::new(optics, spec, white_cd_m2, seed)).transpose()?,
            event: event.map(|(optics, spec)| EventSensor::new(optics, spec, seed)).transpose()?,
            panel: Panel::new(&board, Texture::new(&pattern, alpha, display.gamma), display, seed),
        })
    }

    /// The image of an exposure that begins at `start_s`; an image without pixels where there is no frame camera.
    ///
    /// The noise follows from the seed and `start_s`. A pose that is the same as in the last call costs less than half.
    pub fn expose(&self, rgb_from_target: &Transform<Rgb, Target>, start_s: f64, exposure_s: f64) -> GrayImage {
        let Some(camera) = &self.rgb else { return GrayImage::filled(0, 0, 0) };
        let seen = self.renders[0].at(&self.panel, &camera.lens, rgb_from_target);
        camera.expose(&seen, &self.blink, self.backlight.as_ref(), start_s, exposure_s)
    }

    /// All events from `from_s` (included) to `to_s` (excluded), by time; none where there is no event camera.
    ///
    /// Times of the events are microseconds of the host's clock. Windows that meet give together what one long
    /// window gives. Cost and memory grow with the window: seconds, not hours.
    pub fn events(&self, event_from_target: &Transform<geometry::Event, Target>, from_s: f64, to_s: f64) -> Vec<Event> {
        let Some(sensor) = &self.event else { return Vec::new() };
        let seen = self.renders[1].at(&self.panel, &sensor.lens, event_from_target);
        sensor.events(&seen, &self.blink, self.backlight.as_ref(), from_s, to_s)
    }

    /// The frame camera's image of one state of the display, free of noise; for tests and pictures.
    pub fn state_rgb(&self, rgb_from_target: &Transform<Rgb, Target>, state: State) -> GrayImage {
        let Some(camera) = &self.rgb else { return GrayImage::filled(0, 0, 0) };
        camera.state(&Rendered::new(&self.panel, &camera.lens, rgb_from_target), state == State::Blended)
    }

    /// Where the frame camera truly sees a point of the board, in pixels, with the bow of the display.
    ///
    /// `None` outside its image, behind it, or without that camera. The same for the event camera below.
    pub fn project_rgb(
        &self,
        rgb_from_target: &Transform<Rgb, Target>,
        point_in_target: Point<Target>,
    ) -> Option<[f64; 2]> {
        self.project(&self.rgb.as_ref()?.lens, rgb_from_target, point_in_target)
    }

    /// Where the event camera truly sees a point of the board; see [`Scene::project_rgb`].
    pub fn project_event(
        &self,
        event_from_target: &Transform<geometry::Event, Target>,
        point_in_target: Point<Target>,
    ) -> Option<[f64; 2]> {
        self.project(&self.event.as_ref()?.lens, event_from_target, point_in_target)
    }

    fn project<C>(
        &self,
        lens: &Lens,
        camera_from_target: &Transform<C, Target>,
        point: Point<Target>,
    ) -> Option<[f64; 2]> {
        let [x, y, z] = point.xyz_m();
        let bent = Point::assume_frame([x, y, z + self.panel.bow.height_m(x, y)]);
        let px = lens.pinhole.project(&(*camera_from_target * bent).coords_m().into())?;
        lens.pinhole.sees(px).then_some(px)
    }
}

fn check_pattern(board: &Board, pattern: &GrayImage) -> Result<(), SceneError> {
    let &Board { squares_x, squares_y, .. } = board;
    let &GrayImage { width, height, .. } = pattern;
    let bytes = pattern.pixels.len();
    let px_per_square = width / squares_x as usize;
    let fits = px_per_square > 0
        && width == px_per_square * squares_x as usize
        && height == px_per_square * squares_y as usize
        && bytes == width * height;
    if fits { Ok(()) } else { Err(SceneError::Pattern { width, height, bytes, squares_x, squares_y }) }
}
