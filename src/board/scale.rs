//! How many pixels a square may have.

use super::Board;

/// Most pixels a square that are tried.
const LARGEST_STEP_PX: u32 = 400;
/// A module this near to a whole number of pixels is whole.
const WHOLE_PX: f64 = 1e-3;

impl Board {
    /// Smallest side of a square, px, at which every module of a marker has whole pixels; its multiples do too.
    ///
    /// `modules` is the number of modules along a marker, its black border included. `None` where no
    /// side up to 400 px does.
    pub fn whole_px_step(&self, modules: u32) -> Option<u32> {
        let modules_per_square = f64::from(modules) * self.square_m / self.marker_m;
        (1..=LARGEST_STEP_PX).find(|px| {
            let module_px = f64::from(*px) / modules_per_square;
            module_px.round() >= 1.0 && (module_px - module_px.round()).abs() < WHOLE_PX
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_makes_modules_whole() {
        let board = |marker_m| Board {
            squares_x: 7,
            squares_y: 5,
            square_m: 0.012,
            marker_m,
            dictionary: "DICT_4X4_50".into(),
        };
        // 6 modules are 0.8 of the square: 2 px a module at 15 px a square.
        assert_eq!(board(0.0096).whole_px_step(6), Some(15));
        assert_eq!(board(0.0096).whole_px_step(8), Some(10));
        assert_eq!(board(0.009).whole_px_step(6), Some(8));
        assert_eq!(board(0.008611).whole_px_step(6), None);
    }
}
