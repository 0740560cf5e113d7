//! Where the board is in an image, as far as a plane says: from squares of the board to pixels.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};

use crate::board::{Board, View};
use crate::image::GrayImage;

/// Fewer corners do not say where the board ends.
const CORNERS_MIN: usize = 6;
/// The equations of corners on one line leave more than one plane: their second eigenvalue is next to nothing.
const SECOND_MIN: f64 = 1e-6;

/// The plane of the board in an image.
#[derive(Debug, Clone)]
pub(super) struct BoardInImage {
    image_from_squares: Matrix3<f64>,
    squares: [f64; 2],
}

impl BoardInImage {
    /// By the corners of a view; `None` where they are too few or on a line. Lens distortion is left over: some px.
    pub(super) fn find(board: &Board, view: &View) -> Option<Self> {
        let square = |p: [f64; 3]| [p[0] / board.square_m, p[1] / board.square_m];
        let pairs: Vec<_> =
            view.corners.iter().filter_map(|c| Some((square(board.corner(c.id)?.xyz_m()), c.px))).collect();
        Self::through(board, &pairs)
    }

    /// By points of the board (squares from its outer top-left corner) and of the image (px).
    pub(super) fn through(board: &Board, pairs: &[([f64; 2], [f64; 2])]) -> Option<Self> {
        if pairs.len() < CORNERS_MIN {
            return None;
        }
        let (from, to) = (Scaled::of(pairs.iter().map(|p| p.0)), Scaled::of(pairs.iter().map(|p| p.1)));
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        for (a, b) in pairs {
            let ([x, y], [u, v]) = (from.apply(*a), to.apply(*b));
            let rows = [[x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u], [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v]];
            for row in rows.map(SVector::<f64, 9>::from) {
                normal += row * row.transpose();
            }
        }
        let eigen = SymmetricEigen::new(normal);
        let mut order: Vec<usize> = (0..9).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let spans = eigen.eigenvalues[order[1]] > SECOND_MIN * eigen.eigenvalues[order[8]];
        let h = eigen.eigenvectors.column(order[0]);
        let h = Matrix3::from_row_slice(h.as_slice());
        let image_from_squares = to.matrix().try_inverse()? * h * from.matrix();
        let found = Self { image_from_squares, squares: [board.squares_x, board.squares_y].map(f64::from) };
        (spans && found.is_in_front()).then_some(found)
    }

    /// Whether the whole board is on one side of the horizon.
    fn is_in_front(&self) -> bool {
        let [x, y] = self.squares;
        let depth = |x: f64, y: f64| (self.image_from_squares * Vector3::new(x, y, 1.0)).z;
        let depths = [depth(0.0, 0.0), depth(x, 0.0), depth(x, y), depth(0.0, y)];
        depths.iter().all(|d| *d > 0.0) || depths.iter().all(|d| *d < 0.0)
    }

    /// Where a point of the board is, in squares from its outer top-left corner.
    pub(super) fn px(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let p = self.image_from_squares * Vector3::new(x, y, 1.0);
        [p.x / p.z, p.y / p.z]
    }

    /// A rectangle of the board.
    pub(super) fn quad(&self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> Quad {
        Quad([[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|p| self.px(p)))
    }

    /// The whole board.
    pub(super) fn outline(&self) -> Quad {
        self.quad([0.0, 0.0], self.squares)
    }
}

/// Points moved to their mean and scaled to about 1, for the numbers' sake.
struct Scaled {
    mean: [f64; 2],
    scale: f64,
}

impl Scaled {
    fn of(points: impl Iterator<Item = [f64; 2]> + Clone) -> Self {
        let count = points.clone().count().max(1) as f64;
        let mean = points.clone().fold([0.0; 2], |m, p| [m[0] + p[0] / count, m[1] + p[1] / count]);
        let spread = points.map(|p| (p[0] - mean[0]).hypot(p[1] - mean[1])).sum::<f64>() / count;
        Self { mean, scale: 1.0 / spread.max(1e-9) }
    }

    fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x - self.mean[0]) * self.scale, (y - self.mean[1]) * self.scale]
    }

    fn matrix(&self) -> Matrix3<f64> {
        let &Self { mean: [x, y], scale: s } = self;
        Matrix3::new(s, 0.0, -s * x, 0.0, s, -s * y, 0.0, 0.0, 1.0)
    }
}

/// A convex quadrilateral in an image, its corners in order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quad(pub(super) [[f64; 2]; 4]);

impl Quad {
    /// The pixels whose centres are inside, as far as the image goes.
    pub(super) fn pixels(self, image: &GrayImage) -> impl Iterator<Item = (usize, usize)> {
        let [columns, rows] = self.range([image.width, image.height]);
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y)))
            .filter(move |(x, y)| self.has([*x as f64, *y as f64]))
    }

    fn range(&self, size: [usize; 2]) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|axis| {
            let along = self.0.map(|p| p[axis]);
            let low = along.into_iter().fold(f64::INFINITY, f64::min).ceil().max(0.0);
            let high = along.into_iter().fold(f64::NEG_INFINITY, f64::max).floor().min(size[axis] as f64 - 1.0);
            // What is not a number or lies outside gives an empty range.
            if low <= high { low as usize..high as usize + 1 } else { 0..0 }
        })
    }

    fn has(&self, [x, y]: [f64; 2]) -> bool {
        let side = |i: usize| {
            let ([ax, ay], [bx, by]) = (self.0[i], self.0[(i + 1) % 4]);
            (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        };
        let sides = [side(0), side(1), side(2), side(3)];
        sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
    }
}
