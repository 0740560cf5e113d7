//! Which places before the cameras have been captured, and where the board is wanted next.

use crate::board::View;

/// Two places are the same where centre, size and shape differ by less than this, shares of the image width.
const SAME: f64 = 0.04;
/// Columns and rows into which the image is divided.
const GRID: usize = 3;
/// Share of the largest size above which a board counts as near, below the other as far.
const FAR: f64 = 0.75;

/// Where a board stood in the image; all lengths are shares of the image width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    centre: [f64; 2],
    /// Standard deviations of the corners along x and y, and their mixed moment.
    shape: [f64; 3],
    /// Third moments along x and y: which side of the board is nearer.
    skew: [f64; 2],
}

impl Place {
    /// The place of a view in an image of this size, px; `None` with fewer than four corners.
    pub(super) fn of(view: &View, [width, _]: [u32; 2]) -> Option<Self> {
        let n = view.corners.len() as f64;
        if view.corners.len() < 4 || width == 0 {
            return None;
        }
        let unit = |px: [f64; 2]| px.map(|v| v / f64::from(width));
        let points: Vec<[f64; 2]> = view.corners.iter().map(|c| unit(c.px)).collect();
        let mean = |of: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(of).sum::<f64>() / n;
        let centre = [mean(&|p| p[0]), mean(&|p| p[1])];
        let moment = |i: i32, j: i32| mean(&|p| (p[0] - centre[0]).powi(i) * (p[1] - centre[1]).powi(j));
        let mixed = moment(1, 1);
        let shape = [moment(2, 0).sqrt(), moment(0, 2).sqrt(), mixed.abs().sqrt() * mixed.signum()];
        Some(Self { centre, shape, skew: [moment(3, 0).cbrt(), moment(0, 3).cbrt()] })
    }

    fn size(&self) -> f64 {
        self.shape[0].hypot(self.shape[1])
    }

    fn differs_from(&self, other: &Self) -> f64 {
        let numbers = |p: &Self| [&p.centre[..], &p.shape, &p.skew].concat();
        let squares = numbers(self).into_iter().zip(numbers(other)).map(|(a, b)| (a - b) * (a - b));
        squares.sum::<f64>().sqrt()
    }
}

/// The places that have been captured.
#[derive(Debug, Default)]
pub(super) struct Coverage {
    places: Vec<Place>,
}

impl Coverage {
    pub(super) fn add(&mut self, place: Place) {
        self.places.push(place);
    }

    /// Whether a capture here would show something new.
    pub(super) fn is_new(&self, place: &Place) -> bool {
        self.places.iter().all(|known| known.differs_from(place) > SAME)
    }

    /// What the operator should do next.
    pub(super) fn advice(&self, taken: usize, wanted: usize) -> String {
        let missing = wanted.saturating_sub(taken);
        let Some(largest) = self.places.iter().map(Place::size).reduce(f64::max) else {
            return "hold the board in the middle of the view, then keep it still".into();
        };
        let near = self.places.iter().filter(|p| p.size() > FAR * largest).count();
        let turned = self.places.iter().filter(|p| p.skew[0].abs() + p.skew[1].abs() > 0.5 * SAME).count();
        let few = self.places.len().div_ceil(4);
        if turned < few {
            return format!("tilt the board, about 20 to 30 degrees, another way each time; {missing} to go");
        }
        if self.places.len() > 4 && near > self.places.len() - few {
            return format!("hold it farther away; {missing} to go");
        }
        format!("hold it {}; {missing} to go", self.emptiest())
    }

    /// The part of the image with the fewest captures.
    fn emptiest(&self) -> &'static str {
        const NAMES: [&str; GRID * GRID] = [
            "to the upper left",
            "up",
            "to the upper right",
            "to the left",
            "in the middle",
            "to the right",
            "to the lower left",
            "down",
            "to the lower right",
        ];
        // The image is about 16 to 9; centres keep off its borders by half a board.
        let cell = |v: f64, middle: f64| {
            if v < middle - 0.06 {
                0
            } else if v > middle + 0.06 {
                2
            } else {
                1
            }
        };
        let mut counts = [0_usize; GRID * GRID];
        for place in &self.places {
            let index = cell(place.centre[1], 0.28) * GRID + cell(place.centre[0], 0.5);
            counts[index] += 1;
        }
        let emptiest = (0..counts.len()).min_by_key(|i| counts[*i]).unwrap_or(4);
        NAMES[emptiest]
    }
}
