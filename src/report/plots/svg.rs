//! A small writer of SVG, and axes. Shapes with a number that is not finite are left out.

use std::fmt::Write as _;

use super::super::html::escape;

/// Where text is held.
#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A drawing that grows.
pub(super) struct Svg {
    width: f64,
    height: f64,
    body: String,
}

impl Svg {
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self { width, height, body: String::new() }
    }

    pub(super) fn line(&mut self, class: &str, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) {
        self.shape(&[x1, y1, x2, y2], |v| {
            format!(r#"<line class="{class}" x1="{}" y1="{}" x2="{}" y2="{}"/>"#, v[0], v[1], v[2], v[3])
        });
    }

    pub(super) fn polygon(&mut self, class: &str, points: &[[f64; 2]]) {
        self.shape(points.as_flattened(), |v| {
            let pairs: Vec<String> = v.chunks(2).map(|p| p.join(",")).collect();
            format!(r#"<polygon class="{class}" points="{}"/>"#, pairs.join(" "))
        });
    }

    /// `hint` is shown when the pointer rests on it; empty for none.
    pub(super) fn rect(&mut self, class: &str, [x, y]: [f64; 2], [width, height]: [f64; 2], hint: &str) {
        let inside = title(hint);
        self.shape(&[x, y, width, height], |v| {
            let at = format!(r#"x="{}" y="{}" width="{}" height="{}""#, v[0], v[1], v[2], v[3]);
            format!(r#"<rect class="{class}" {at}>{inside}</rect>"#)
        });
    }

    /// `hint` is shown when the pointer rests on it; empty for none.
    pub(super) fn circle(&mut self, class: &str, [x, y]: [f64; 2], radius: f64, hint: &str) {
        let inside = title(hint);
        self.shape(&[x, y, radius], |v| {
            format!(r#"<circle class="{class}" cx="{}" cy="{}" r="{}">{inside}</circle>"#, v[0], v[1], v[2])
        });
    }

    pub(super) fn text(&mut self, class: &str, at: [f64; 2], anchor: Anchor, text: &str) {
        self.turned(class, at, anchor, 0.0, text);
    }

    /// Text turned by `degrees`, clockwise, about where it is held.
    pub(super) fn turned(&mut self, class: &str, [x, y]: [f64; 2], anchor: Anchor, degrees: f64, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let text = escape(text);
        self.shape(&[x, y, degrees], |v| {
            let turn = if degrees == 0.0 {
                String::new()
            } else {
                format!(r#" transform="rotate({} {} {})""#, v[2], v[0], v[1])
            };
            format!(r#"<text class="{class}" x="{}" y="{}" text-anchor="{anchor}"{turn}>{text}</text>"#, v[0], v[1])
        });
    }

    /// The element; `label` is read out instead of it.
    pub(super) fn finish(self, label: &str) -> String {
        let Self { width, height, body } = self;
        let (label, size) = (escape(label), format!(r#"viewBox="0 0 {width:.0} {height:.0}""#));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" {size} width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" \
             aria-label=\"{label}\">\n{body}</svg>\n"
        )
    }

    fn shape(&mut self, numbers: &[f64], write: impl Fn(&[String]) -> String) {
        // Beyond a million no drawing is meant, and f32 renderers go wrong.
        if numbers.iter().all(|v| v.abs() < 1e6) {
            let texts: Vec<String> = numbers.iter().map(|v| short(*v)).collect();
            let _ = writeln!(self.body, "{}", write(&texts));
        }
    }
}

fn title(hint: &str) -> String {
    if hint.is_empty() { String::new() } else { format!("<title>{}</title>", escape(hint)) }
}

/// At most two decimals, no trailing zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

/// A range of values on a stretch of the drawing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    pub(super) low: f64,
    pub(super) high: f64,
    /// Where `low` is drawn.
    pub(super) from: f64,
    /// Where `high` is drawn.
    pub(super) to: f64,
}

impl Scale {
    pub(super) fn at(&self, value: f64) -> f64 {
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }

    /// Round values from low to high, about `wanted` of them.
    pub(super) fn ticks(&self, wanted: usize) -> Vec<f64> {
        self.every(round_step((self.high - self.low) / wanted.max(1) as f64))
    }

    /// The multiples of `step` from low to high; none where there would be more than a hundred.
    pub(super) fn every(&self, step: f64) -> Vec<f64> {
        let (first, last) = ((self.low / step).ceil(), (self.high / step).floor());
        let steps = if (0.0..=100.0).contains(&(last - first)) { (last - first) as usize } else { return Vec::new() };
        (0..=steps).map(|i| (first + i as f64) * step).collect()
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `step`.
pub(super) fn round_step(step: f64) -> f64 {
    let magnitude = 10.0_f64.powf(step.abs().log10().floor());
    let times = [1.0, 2.0, 5.0].into_iter().find(|t| t * magnitude >= step * (1.0 - 1e-9)).unwrap_or(10.0);
    times * magnitude
}

/// A tick's value, with as many digits as its neighbours need.
pub(super) fn tick_text(value: f64, ticks: &[f64]) -> String {
    let step = ticks.windows(2).map(|w| (w[1] - w[0]).abs()).fold(f64::INFINITY, f64::min);
    let decimals = if step.is_finite() && step > 0.0 { (-step.log10().floor()).clamp(0.0, 6.0) as usize } else { 0 };
    super::super::numbers::fixed(value, decimals)
}

/// A label that fits under a narrow column.
pub(super) fn clipped(text: &str, longest: usize) -> String {
    if text.chars().count() <= longest {
        return text.to_owned();
    }
    text.chars().take(longest.saturating_sub(1)).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let scale = Scale { low: -2.3, high: 4.1, from: 0.0, to: 100.0 };
        let ticks = scale.ticks(6);
        assert_eq!(ticks, [-2.0, 0.0, 2.0, 4.0]);
        assert_eq!(tick_text(2.0, &ticks), "2");
        assert_eq!(tick_text(0.1, &[0.1, 0.2]), "0.1");
        let broken = Scale { low: 0.0, high: f64::NAN, from: 0.0, to: 1.0 };
        assert!(broken.ticks(5).is_empty());
        assert!(Scale { low: 1.0, high: 1.0, from: 0.0, to: 1.0 }.ticks(5).is_empty());
    }

    #[test]
    fn what_is_not_finite_is_not_drawn_and_text_is_escaped() {
        let mut svg = Svg::new(10.0, 10.0);
        svg.line("a", [0.0, f64::NAN], [1.0, 1.0]);
        svg.circle("a", [f64::INFINITY, 0.0], 1.0, "");
        svg.circle("a", [1.0, 2.5], 1.0, "<b>");
        svg.text("a", [-0.001, 0.0], Anchor::Start, "x & <y>");
        let text = svg.finish("\"l\"");
        assert!(!text.contains("NaN") && !text.contains("inf") && !text.contains("<b>"), "{text}");
        assert!(text.contains(r#"<text class="a" x="0" y="0" text-anchor="start">x &amp; &lt;y&gt;</text>"#), "{text}");
    }
}
