//! What was looked at, ready to be shown: corners, aids, pictures.

use rayon::prelude::*;
use serde_json::{Value, json};

use crate::board::{Board, Corner, View};
use crate::geometry::Camera;
use crate::image::{ColorImage, GrayImage};
use crate::runner::Looked;
use crate::vision::aids::{Aids, EventAids, FrameAids, Reading};
use crate::vision::{event_view, frame_view};

/// Corners in pictures: a bright line in a dark border stands out from white and from black.
pub(super) const MARK: [u8; 3] = [0, 230, 118];
const BORDER: [u8; 3] = [0, 0, 0];
/// Half length of the cross at a corner, as a share of the picture's width, and at least this many pixels.
const CROSS_SHARE: f64 = 0.006;

/// What one camera saw.
pub(super) struct Shown {
    pub(super) camera: Camera,
    pub(super) image: GrayImage,
    pub(super) view: View,
    pub(super) aids: AidsOf,
}

/// The aids of either camera.
pub(super) enum AidsOf {
    Frame(FrameAids),
    Event(EventAids),
}

impl AidsOf {
    pub(super) fn readings(&self) -> Vec<Reading> {
        match self {
            Self::Frame(aids) => aids.readings(),
            Self::Event(aids) => aids.readings(),
        }
    }

    /// The numbers.
    pub(super) fn json(&self) -> Value {
        match self {
            Self::Frame(aids) => json!(aids),
            Self::Event(aids) => json!(aids),
        }
    }
}

/// Finds corners and judges; both cameras at once.
pub(super) fn judge(board: &Board, aids: &Aids, looked: &Looked) -> Vec<Shown> {
    let frame = || {
        let image = looked.frame.clone()?;
        // An image in which nothing can be looked for has no corners; the aids say so.
        let view = frame_view(board, &image).unwrap_or_default();
        let aids = AidsOf::Frame(aids.frame(&image, &view));
        Some(Shown { camera: Camera::Rgb, image, view, aids })
    };
    let event = || {
        let events = looked.events.as_ref()?;
        let image = events.image.clone();
        let view = event_view(board, &image).unwrap_or_default();
        let aids = AidsOf::Event(aids.events(&image, &view, events.events, events.window_s()));
        Some(Shown { camera: Camera::Event, image, view, aids })
    };
    let (frame, event) = rayon::join(frame, event);
    frame.into_iter().chain(event).collect()
}

impl Shown {
    /// The image with its corners, `width` pixels wide, made smaller where that is less.
    pub(super) fn picture(&self, width: usize) -> ColorImage {
        let width = width.clamp(1, self.image.width.max(1));
        let height = (width * self.image.height).div_ceil(self.image.width.max(1));
        let mut picture = shrunk(&self.image, width, height);
        let scale = width as f64 / self.image.width.max(1) as f64;
        mark(&mut picture, &self.view.corners, scale);
        picture
    }
}

/// Means over the pixels that fall together.
fn shrunk(image: &GrayImage, width: usize, height: usize) -> ColorImage {
    if (width, height) == (image.width, image.height) {
        return ColorImage::from(image);
    }
    let range = |i: usize, new: usize, old: usize| i * old / new..((i + 1) * old).div_ceil(new).min(old);
    let value = |i: usize| {
        let (columns, rows) = (range(i % width, width, image.width), range(i / width, height, image.height));
        let count = (columns.len() * rows.len()).max(1);
        let sum: usize = rows.map(|y| columns.clone().map(|x| usize::from(image.at(x, y))).sum::<usize>()).sum();
        [(sum / count) as u8; 3]
    };
    ColorImage { width, height, pixels: (0..width * height).into_par_iter().map(value).collect() }
}

/// Crosses with a border; one pixel each, without, in a picture of few pixels.
///
/// All borders come first: a corner that is near another keeps its cross.
fn mark(picture: &mut ColorImage, corners: &[Corner], scale: f64) {
    let half = (CROSS_SHARE * picture.width as f64).round() as i64;
    let border = i64::from(half > 0);
    for (color, around) in [(BORDER, border), (MARK, 0)] {
        for corner in corners {
            let [x, y] = corner.px.map(|v| ((v + 0.5) * scale - 0.5).round() as i64);
            for along in -half - around..=half + around {
                for beside in -around..=around {
                    picture.put(x.saturating_add(along), y.saturating_add(beside), color);
                    picture.put(x.saturating_add(beside), y.saturating_add(along), color);
                }
            }
        }
    }
}

/// What is said about every camera, for pages and scripts.
pub(super) fn readings_json(shown: &[Shown], number: u64) -> Value {
    let of = |shown: &Shown| {
        let told = json!({ "readings": shown.aids.readings(), "aids": shown.aids.json() });
        (shown.camera.name().to_owned(), told)
    };
    let cameras: serde_json::Map<String, Value> = shown.iter().map(of).collect();
    json!({ "number": number, "cameras": cameras })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown() -> Shown {
        let pixels = (0..40 * 20).map(|i| if i % 40 < 20 { 40 } else { 200 }).collect();
        let image = GrayImage { width: 40, height: 20, pixels };
        let view = View::new(vec![Corner::at(0, [29.5, 9.5]), Corner::at(1, [-50.0, 1e12])]);
        let aids = AidsOf::Event(EventAids {
            corners: 1,
            expected: 24,
            coverage: None,
            fill: None,
            rate_kev_s: 1.0,
            window_s: 0.1,
        });
        Shown { camera: Camera::Event, image, view, aids }
    }

    #[test]
    fn pictures_keep_their_shape_and_corners_their_place() {
        let small = shown().picture(10);
        assert_eq!((small.width, small.height), (10, 5));
        assert_eq!((small.at(0, 0), small.at(9, 4)), ([40; 3], [200; 3]));
        // The pixel from 28 to 32, 8 to 12.
        assert_eq!(small.at(7, 2), MARK);
        assert_eq!(small.pixels.iter().filter(|p| **p == MARK).count(), 1);
        let whole = shown().picture(4000);
        assert_eq!((whole.width, whole.height), (40, 20), "never larger than it is");
    }

    #[test]
    fn marks_stand_out_from_white_and_from_black() {
        // Brightness as it is seen, by ITU-R BT.709.
        let seen = |c: [u8; 3]| 0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2]);
        for ground in [0, 255] {
            let mut picture = ColorImage::from(&GrayImage::filled(400, 300, ground));
            mark(&mut picture, &[Corner::at(0, [200.0, 150.0])], 1.0);
            let of = |color: [u8; 3]| picture.pixels.iter().filter(|p| **p == color).count();
            // 0.006 of 400 is 2: arms of 2 pixels and the middle, in a border of one pixel.
            assert_eq!(of(MARK), 9);
            assert_eq!(picture.at(202, 150), MARK);
            let (border, own) = (picture.at(203, 150), seen(MARK));
            assert!((own - seen(border)).abs() > 100.0 && (own - seen(picture.at(210, 150))).abs() > 80.0);
            // The border alone stands out where the cross does not: on its own green.
            assert_eq!(picture.at(201, 151), BORDER);
        }
    }
}
