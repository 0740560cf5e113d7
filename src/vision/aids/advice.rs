//! Numbers of the aids in words, each with what to turn where it is out of bounds.

use serde::Serialize;

use super::{EventAids, FrameAids};

/// The same share as the usual gate on the corner rate.
const CORNERS_MIN: f64 = 0.8;
/// Corners are refined within 5 px to each side; an edge should be well inside, px.
const EDGE_MAX_PX: f64 = 4.0;
/// More of the board than this at 255 hides where edges are.
const AT_255_MAX: f64 = 0.01;
/// More of the board than this at 0 cuts off its dark half.
const AT_0_MAX: f64 = 0.25;
/// White should be this bright: noise and rounding are about 1 to 3 DN.
const LIGHT_MIN: f64 = 50.0;
/// Below this markers get lost, (light - dark) / (light + dark).
const CONTRAST_MIN: f64 = 0.4;
/// The board should cover this much of the image, and leave room to be moved.
const COVERAGE: [f64; 2] = [0.05, 0.6];
/// Black squares should fire almost whole: the median filter closes single holes only.
const FILL_MIN: f64 = 0.9;
/// Fewer events are noise, more may get lost on the way, kev/s.
const RATE_KEV_S: [f64; 2] = [100.0, 30_000.0];

/// One aid for people.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reading {
    /// What it is.
    pub name: &'static str,
    /// Its value with its unit.
    pub value: String,
    /// What to do, where the value is out of bounds.
    pub advice: Option<String>,
}

fn reading(name: &'static str, value: String, advice: Option<String>) -> Reading {
    Reading { name, value, advice }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn corners(found: usize, expected: usize, where_to_look: &str) -> Reading {
    let advice = match found {
        0 => Some(format!("no board: point the camera at the display, and see that {where_to_look}")),
        _ if (found as f64) < CORNERS_MIN * expected as f64 => Some(format!(
            "only {found} of {expected} corners: bring the whole board into view, and see that {where_to_look}"
        )),
        _ => None,
    };
    reading("corners", format!("{found} of {expected}"), advice)
}

fn coverage(share: f64) -> Reading {
    let [low, high] = COVERAGE;
    let advice = if share < low {
        Some(format!("go nearer or take a longer lens: the board covers {}, below {}", percent(share), percent(low)))
    } else if share > high {
        Some(format!("go back: the board covers {}, above {}, and needs room to move", percent(share), percent(high)))
    } else {
        None
    };
    reading("board in image", percent(share), advice)
}

impl FrameAids {
    /// In words.
    pub fn readings(&self) -> Vec<Reading> {
        let mut all = vec![corners(self.corners, self.expected, "it is lit and not saturated")];
        all.extend(self.edge_width_px.map(|px| self.sharpness(px)));
        all.extend(self.exposure());
        all.extend(self.coverage.map(coverage));
        all
    }

    fn sharpness(&self, px: f64) -> Reading {
        let advice = (px > EDGE_MAX_PX).then(|| {
            format!("refocus, or close the iris: edges are {px:.1} px wide from 10 to 90 %, above {EDGE_MAX_PX}")
        });
        reading("edge width", format!("{px:.2} px"), advice)
    }

    fn exposure(&self) -> [Reading; 5] {
        let &Self { at_0, at_255, dark, light, contrast, .. } = self;
        let bright = at_255 > AT_255_MAX;
        let too_bright = bright.then(|| {
            let (found, most) = (percent(at_255), percent(AT_255_MAX));
            format!("close the iris or expose shorter: {found} of the pixels are at 255, above {most}")
        });
        let too_black = (at_0 > AT_0_MAX && !bright).then(|| {
            let (found, most) = (percent(at_0), percent(AT_0_MAX));
            format!("open the iris or raise the black level: {found} of the pixels are at 0, above {most}")
        });
        let too_dark = (light < LIGHT_MIN)
            .then(|| format!("open the iris or expose longer: white is at {light} of 255, below {LIGHT_MIN}"));
        let clear = contrast >= CONTRAST_MIN;
        let flat = (!clear).then(|| {
            format!("shade the display from light or make it brighter: contrast {contrast:.2}, below {CONTRAST_MIN}")
        });
        [
            reading("white", format!("{light}"), too_dark),
            reading("black", format!("{dark}"), None),
            reading("contrast", format!("{contrast:.2}"), flat),
            reading("at 255", percent(at_255), too_bright),
            reading("at 0", percent(at_0), too_black),
        ]
    }
}

impl EventAids {
    /// In words.
    pub fn readings(&self) -> Vec<Reading> {
        let mut all = vec![corners(self.corners, self.expected, "it blinks"), self.rate()];
        all.extend(self.fill.map(fill));
        all.extend(self.coverage.map(coverage));
        all
    }

    fn rate(&self) -> Reading {
        let ([low, high], rate) = (RATE_KEV_S, self.rate_kev_s);
        let advice = if rate < low {
            Some(format!("start the blinking display or open the iris: {rate:.0} kev/s, below {low}"))
        } else if rate > high {
            Some(format!(
                "raise the thresholds (`diff_on`, `diff_off`) or look for flickering light: {rate:.0} kev/s, above {high}"
            ))
        } else {
            None
        };
        reading("event rate", format!("{rate:.0} kev/s"), advice)
    }
}

fn fill(share: f64) -> Reading {
    let (found, least) = (percent(share), percent(FILL_MIN));
    let advice = (share < FILL_MIN).then(|| {
        format!(
            "make the display brighter, open the iris or lower the thresholds: {found} of black fires, below {least}"
        )
    });
    reading("black that fires", found, advice)
}
