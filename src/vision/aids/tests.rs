//! Aids against boards that are drawn with known blur, tones and events.

use super::*;
use crate::board::Corner;

const SQUARE_PX: f64 = 62.0;
/// Subpixels a pixel and axis.
const FINE: usize = 4;

fn board() -> Board {
    Board { squares_x: 7, squares_y: 5, square_m: 0.0088, marker_m: 0.00704, dictionary: "DICT_4X4_50".into() }
}

/// Turned by `turn_rad` about its outer top-left corner, which is at (110, 60).
struct Drawn {
    turn_rad: f64,
    size: [usize; 2],
}

impl Drawn {
    const SLANTED: Self = Self { turn_rad: 0.09, size: [600, 440] };

    fn px(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (s, c) = self.turn_rad.sin_cos();
        [110.0 + SQUARE_PX * (c * x - s * y), 60.0 + SQUARE_PX * (s * x + c * y)]
    }

    fn squares(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let ((s, c), x, y) = (self.turn_rad.sin_cos(), (u - 110.0) / SQUARE_PX, (v - 60.0) / SQUARE_PX);
        [c * x + s * y, -s * x + c * y]
    }

    fn view(&self) -> View {
        let px = |id| self.px(board().corner(id).unwrap().xyz_m().map(|m| m / 0.0088)[..2].try_into().unwrap());
        View::new((0..24).map(|id| Corner::at(id, px(id))).collect())
    }

    /// Blurred by a Gaussian of `sigma_px`, with these tones; sampled, not averaged, over pixels.
    fn image(&self, sigma_px: f64, [dark, light]: [f64; 2]) -> GrayImage {
        let pattern = charuco::draw(&board(), 120).unwrap();
        let [w, h] = self.size.map(|n| n * FINE);
        let value = |i: usize| {
            let [x, y] = self.squares([(i % w) as f64 / FINE as f64, (i / w) as f64 / FINE as f64]);
            let inside = (0.0..7.0).contains(&x) && (0.0..5.0).contains(&y);
            if inside && pattern.at((x * 120.0) as usize, (y * 120.0) as usize) == 0 { dark } else { light }
        };
        let sharp: Vec<f64> = (0..w * h).map(value).collect();
        let rows = blurred(&sharp, w, 1, sigma_px * FINE as f64);
        let both = blurred(&rows, w, w, sigma_px * FINE as f64);
        let pixels = (0..self.size[0] * self.size[1]).map(|i| {
            let (x, y) = (i % self.size[0] * FINE, i / self.size[0] * FINE);
            both[y * w + x].round().clamp(0.0, 255.0) as u8
        });
        GrayImage { width: self.size[0], height: self.size[1], pixels: pixels.collect() }
    }
}

/// One direction of a Gaussian; `step` is 1 along rows and `width` along columns.
fn blurred(values: &[f64], width: usize, step: usize, sigma: f64) -> Vec<f64> {
    let half = (4.0 * sigma).ceil() as i64;
    let kernel: Vec<f64> = (-half..=half).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let (length, lines) = if step == 1 { (width, values.len() / width) } else { (values.len() / width, width) };
    let mut out = vec![0.0; values.len()];
    for line in 0..lines {
        let at = |i: usize| if step == 1 { line * width + i } else { i * width + line };
        for i in 0..length {
            let tap = |(k, weight): (usize, &f64)| {
                let from = (i as i64 + k as i64 - half).clamp(0, length as i64 - 1) as usize;
                weight * values[at(from)]
            };
            out[at(i)] = kernel.iter().enumerate().map(tap).sum::<f64>() / total;
        }
    }
    out
}

/// A Gaussian edge goes from 10 % to 90 % over 2 * 1.28155 standard deviations.
const WIDTH_OF_SIGMA: f64 = 2.0 * 1.281_551_565_5;

#[test]
fn edges_are_as_wide_as_they_were_blurred() {
    let aids = Aids::new(&board()).unwrap();
    for sigma_px in [0.7, 1.0, 1.6, 2.5, 5.0] {
        let drawn = Drawn::SLANTED;
        let found = aids.frame(&drawn.image(sigma_px, [20.0, 200.0]), &drawn.view());
        let (width_px, truth_px) = (found.edge_width_px.unwrap(), WIDTH_OF_SIGMA * sigma_px);
        // Bins of 0.5 px add 1/48 px2 to the variance, rounding to whole DN less: 2 % at 0.7 px.
        assert!((width_px / truth_px - 1.0).abs() < 0.05, "{sigma_px}: {width_px} for {truth_px}");
        assert!(found.edges >= 10, "{sigma_px}: {}", found.edges);
        let refocus = found.readings().iter().any(|r| r.advice.as_ref().is_some_and(|a| a.starts_with("refocus")));
        assert_eq!(refocus, truth_px > 4.0, "{sigma_px}");
    }
}

#[test]
fn edges_along_the_pixels_are_measured_too() {
    let aids = Aids::new(&board()).unwrap();
    let drawn = Drawn { turn_rad: 0.0, ..Drawn::SLANTED };
    let found = aids.frame(&drawn.image(1.2, [20.0, 200.0]), &drawn.view());
    // Samples are 1 px apart: the chords of the curve cut at most 0.12 px at either end.
    let truth_px = WIDTH_OF_SIGMA * 1.2;
    assert!((found.edge_width_px.unwrap() - truth_px).abs() < 0.25, "{found:?}");
}

#[test]
fn corners_that_are_bent_aside_do_not_widen_edges() {
    let aids = Aids::new(&board()).unwrap();
    let drawn = Drawn::SLANTED;
    let image = drawn.image(1.0, [20.0, 200.0]);
    let straight = aids.frame(&image, &drawn.view()).edge_width_px.unwrap();
    let bent = |c: &Corner| Corner { px: [c.px[0] + 1.5, c.px[1] - 1.0 + 0.004 * (c.px[0] - 330.0)], ..*c };
    let view = View::new(drawn.view().corners.iter().map(bent).collect());
    assert!((aids.frame(&image, &view).edge_width_px.unwrap() - straight).abs() < 0.1);
}

#[test]
fn tones_and_saturation_are_those_of_the_board() {
    let aids = Aids::new(&board()).unwrap();
    let drawn = Drawn::SLANTED;
    let mut image = drawn.image(1.0, [30.0, 150.0]);
    let found = aids.frame(&image, &drawn.view());
    assert_eq!((found.dark, found.light, found.of_board), (30.0, 150.0, true));
    assert!((found.contrast - 120.0 / 180.0).abs() < 1e-9);
    let area = 35.0 * SQUARE_PX * SQUARE_PX / (600.0 * 440.0);
    assert!((found.coverage.unwrap() - area).abs() < 1e-3, "{found:?}");
    assert!(found.readings().iter().all(|r| r.advice.is_none()), "{:?}", found.readings());

    // Every tenth pixel of the board at 255, every fifth at 0; outside nothing counts.
    let inside: Vec<usize> = (0..image.pixels.len())
        .filter(|i| {
            let [x, y] = drawn.squares([(i % 600) as f64, (i / 600) as f64]);
            (0.0..7.0).contains(&x) && (0.0..5.0).contains(&y)
        })
        .collect();
    for (n, &i) in inside.iter().enumerate() {
        image.pixels[i] = if n % 10 == 0 {
            255
        } else if n % 5 == 2 {
            0
        } else {
            image.pixels[i]
        };
    }
    image.pixels[..600 * 20].fill(255);
    let found = aids.frame(&image, &drawn.view());
    assert!((found.at_255 - 0.1).abs() < 1e-3 && (found.at_0 - 0.2).abs() < 1e-3, "{found:?}");
    let advice: Vec<String> = found.readings().into_iter().filter_map(|r| r.advice).collect();
    assert!(advice.iter().any(|a| a.starts_with("close the iris")), "{advice:?}");
}

#[test]
fn an_image_without_a_board_is_judged_as_a_whole() {
    let aids = Aids::new(&board()).unwrap();
    for value in [0, 7, 255] {
        let found = aids.frame(&GrayImage::filled(64, 48, value), &View::default());
        assert_eq!((found.of_board, found.edge_width_px, found.coverage), (false, None, None));
        assert_eq!((found.dark, found.light, found.contrast), (f64::from(value), f64::from(value), 0.0));
        assert!(found.readings().iter().any(|r| r.advice.is_some()));
    }
    aids.frame(&GrayImage::filled(0, 0, 0), &View::default());
    let on_a_line = View::new((0..6).map(|id| Corner::at(id, [50.0 * f64::from(id), 40.0])).collect());
    assert!(!aids.frame(&GrayImage::filled(64, 48, 9), &on_a_line).of_board);
    let odd = View::new((0..24).map(|id| Corner::at(id, [f64::NAN, f64::INFINITY])).collect());
    assert!(!aids.frame(&GrayImage::filled(64, 48, 9), &odd).of_board);
}

#[test]
fn fill_and_rate_of_events_are_those_drawn() {
    let aids = Aids::new(&board()).unwrap();
    let drawn = Drawn::SLANTED;
    // Black fires; edges are 2 px short of it, which the rim of 9 px leaves out.
    let mut image = drawn.image(0.5, [0.0, 255.0]);
    image.pixels.iter_mut().for_each(|v| *v = if *v < 10 { 0 } else { 255 });
    let whole = aids.events(&image, &drawn.view(), 123_400, 0.1);
    assert_eq!((whole.fill, whole.rate_kev_s), (Some(1.0), 1234.0));
    assert!(whole.readings().iter().all(|r| r.advice.is_none()), "{:?}", whole.readings());
    // A quarter of all pixels, in a pattern that has nothing to do with squares.
    let holes = image.pixels.iter_mut().enumerate().filter(|(i, _)| (i % 600 + i / 600 * 7) % 4 == 0);
    holes.for_each(|(_, v)| *v = 255);
    let holed = aids.events(&image, &drawn.view(), 10, 0.1);
    // 18 squares of 43 x 43 px: the pattern is exact up to their rims.
    assert!((holed.fill.unwrap() - 0.75).abs() < 0.01, "{holed:?}");
    let advice: Vec<String> = holed.readings().into_iter().filter_map(|r| r.advice).collect();
    assert!(advice.iter().any(|a| a.contains("75.0 % of black fires")), "{advice:?}");
    assert!(advice.iter().any(|a| a.starts_with("start the blinking display")), "{advice:?}");
    assert_eq!(aids.events(&image, &View::default(), 0, 0.0).rate_kev_s, 0.0);
}
