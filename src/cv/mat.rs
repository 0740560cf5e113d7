//! Conversions between our types and OpenCV's.

use nalgebra::{Matrix3, Vector3};
use opencv::core::{CV_64F, Mat, Point2f, Point3f, Scalar, Vector};
use opencv::prelude::*;

use super::CvError;
use crate::board::{Board, View};
use crate::geometry::{Pinhole, Transform, rotation};
use crate::image::{ColorImage, GrayImage};

/// Copies a gray image.
pub(super) fn from_gray(image: &GrayImage) -> Result<Mat, CvError> {
    let rows = i32::try_from(image.height).unwrap_or(i32::MAX);
    Ok(Mat::from_slice(&image.pixels)?.reshape(1, rows)?.try_clone()?)
}

/// Copies an 8-bit one-channel matrix.
pub(super) fn to_gray(mat: &Mat) -> Result<GrayImage, CvError> {
    let whole = if mat.is_continuous() { mat.try_clone()? } else { mat.clone() };
    let pixels = whole.data_bytes()?.to_vec();
    Ok(GrayImage { width: whole.cols() as usize, height: whole.rows() as usize, pixels })
}

/// Copies a colour image; OpenCV has blue first.
pub(super) fn from_color(image: &ColorImage) -> Result<Mat, CvError> {
    let rows = i32::try_from(image.height).unwrap_or(i32::MAX);
    let bytes: Vec<u8> = image.pixels.iter().flat_map(|[r, g, b]| [*b, *g, *r]).collect();
    Ok(Mat::from_slice(&bytes)?.reshape(3, rows)?.try_clone()?)
}

/// Copies an 8-bit matrix of blue, green, red.
pub(super) fn to_color(mat: &Mat) -> Result<ColorImage, CvError> {
    let whole = if mat.is_continuous() { mat.try_clone()? } else { mat.clone() };
    let pixels = whole.data_bytes()?.as_chunks().0.iter().map(|[b, g, r]: &[u8; 3]| [*r, *g, *b]).collect();
    Ok(ColorImage { width: whole.cols() as usize, height: whole.rows() as usize, pixels })
}

/// The 3x3 camera matrix.
pub(super) fn camera_matrix(camera: &Pinhole) -> Result<Mat, CvError> {
    let &Pinhole { fx, fy, cx, cy, .. } = camera;
    matrix(3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
}

/// The five distortion terms.
pub(super) fn distortion(camera: &Pinhole) -> Result<Mat, CvError> {
    matrix(5, &camera.distortion)
}

/// A matrix of doubles, row by row.
pub(super) fn matrix(rows: i32, values: &[f64]) -> Result<Mat, CvError> {
    let columns = i32::try_from(values.len()).unwrap_or(i32::MAX) / rows;
    let mut mat = Mat::new_rows_cols_with_default(rows, columns, CV_64F, Scalar::all(0.0))?;
    mat.data_typed_mut::<f64>()?.copy_from_slice(values);
    Ok(mat)
}

/// The doubles of a matrix, row by row.
pub(super) fn values(mat: &Mat) -> Result<Vec<f64>, CvError> {
    Ok(mat.data_typed::<f64>()?.to_vec())
}

/// A camera from OpenCV's matrices; the image size comes from `like`.
pub(super) fn pinhole(camera: &Mat, distortion: &Mat, like: &Pinhole) -> Result<Pinhole, CvError> {
    let (k, d) = (values(camera)?, values(distortion)?);
    let &[fx, _, cx, _, fy, cy, ..] = k.as_slice() else {
        return Err(CvError::Unusable("OpenCV returned a camera matrix that is not 3x3".into()));
    };
    let distortion = std::array::from_fn(|i| d.get(i).copied().unwrap_or(0.0));
    let found = Pinhole { fx, fy, cx, cy, distortion, ..*like };
    let usable = [fx, fy, cx, cy].iter().chain(&distortion).all(|v| v.is_finite()) && fx > 0.0 && fy > 0.0;
    if usable { Ok(found) } else { Err(CvError::Unusable(format!("the solver returned no camera: {found:?}"))) }
}

/// A pose from OpenCV's rotation vector and translation.
pub(super) fn pose<A, B>(rotation_vector: &Mat, translation: &Mat) -> Result<Transform<A, B>, CvError> {
    let (r, t) = (values(rotation_vector)?, values(translation)?);
    match (r.as_slice(), t.as_slice()) {
        (&[rx, ry, rz], &[x, y, z]) if r.iter().chain(&t).all(|v| v.is_finite()) => {
            Ok(Transform::from_parts([x, y, z], rotation::from_vector([rx, ry, rz])))
        }
        _ => Err(CvError::Unusable(format!("the solver returned no pose: {r:?} {t:?}"))),
    }
}

/// A pose from OpenCV's rotation matrix and translation.
pub(super) fn pose_of_matrix<A, B>(rotation_matrix: &Mat, translation: &Mat) -> Result<Transform<A, B>, CvError> {
    let (r, t) = (values(rotation_matrix)?, values(translation)?);
    let unusable = || CvError::Unusable(format!("the solver returned no pose: {r:?} {t:?}"));
    if r.len() != 9 || t.len() != 3 || !t.iter().all(|v| v.is_finite()) {
        return Err(unusable());
    }
    Transform::from_matrix(&Matrix3::from_row_slice(&r), Vector3::from_row_slice(&t)).ok_or_else(unusable)
}

/// Board points (m) and image points (px) of a view, in the same order.
///
/// OpenCV takes both as `f32`: 24 bits are 1e-4 px at 1,600 px and 1e-9 m on a board.
pub(super) fn points(board: &Board, view: &View) -> (Vector<Point3f>, Vector<Point2f>) {
    let seen = view.corners.iter().filter_map(|c| Some((board.corner(c.id)?.xyz_m(), c.px)));
    let (object, image): (Vec<_>, Vec<_>) = seen
        .map(|([x, y, z], [u, v])| (Point3f::new(x as f32, y as f32, z as f32), Point2f::new(u as f32, v as f32)))
        .unzip();
    (object.into(), image.into())
}
