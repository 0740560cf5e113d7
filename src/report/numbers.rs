//! Numbers as they are written in a report. Inner units come in, the named unit goes out, without its name.

use crate::geometry::Transform;

/// `decimals` digits after the point; no `-0.00`, and powers of ten for what no cell can be.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() && value.abs() >= 1e7 {
        return format!("{value:.3e}");
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| matches!(c, '0' | '.')) => zero.to_owned(),
        _ => text,
    }
}

/// Millimetres of metres.
pub(super) fn mm(value_m: f64) -> String {
    fixed(value_m * 1e3, 2)
}

/// Millimetres of metres, with the sign of an error.
pub(super) fn signed_mm(value_m: f64) -> String {
    let text = mm(value_m);
    let above_zero = value_m > 0.0 && text.chars().any(|c| c.is_ascii_digit() && c != '0');
    if above_zero { format!("+{text}") } else { text }
}

/// Degrees of radians.
pub(super) fn deg(value_rad: f64) -> String {
    fixed(value_rad.to_degrees(), 3)
}

/// Pixels, as errors are written.
pub(super) fn px(value_px: f64) -> String {
    fixed(value_px, 3)
}

/// Percent of a share.
pub(super) fn percent(share: f64) -> String {
    fixed(share * 100.0, 1)
}

/// `-` where there is no number.
pub(super) fn or_dash(value: Option<f64>, shown: fn(f64) -> String) -> String {
    value.map_or_else(|| "-".into(), shown)
}

/// `1 pose`, `2 poses`.
pub(super) fn count(n: usize, one: &str) -> String {
    format!("{n} {one}{}", if n == 1 { "" } else { "s" })
}

/// x, y, z of a translation, mm.
pub(super) fn translation_mm<A, B>(transform: &Transform<A, B>) -> [String; 3] {
    transform.translation_m().map(mm)
}

/// The rotation vector, deg.
pub(super) fn rotation_deg<A, B>(transform: &Transform<A, B>) -> [String; 3] {
    transform.rotation_vector_rad().map(deg)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_sensible_digits() {
        assert_eq!(mm(0.067_849), "67.85");
        assert_eq!((mm(-1e-9), signed_mm(-1e-9), signed_mm(1e-9)), ("0.00".into(), "0.00".into(), "0.00".into()));
        assert_eq!((signed_mm(0.001), signed_mm(-0.001)), ("+1.00".into(), "-1.00".into()));
        assert_eq!(deg(std::f64::consts::PI), "180.000");
        assert_eq!(fixed(1e300, 2), "1.000e300");
        assert_eq!((mm(f64::NAN), signed_mm(f64::NAN)), ("NaN".into(), "NaN".into()));
        assert_eq!((count(1, "pose"), count(0, "pose")), ("1 pose".into(), "0 poses".into()));
    }
}
