//! Where robot, cameras and target are, seen from above and from the side; same scale in both.

use nalgebra::Vector3;

use super::super::sections::kind_name;
use super::Figure;
use super::svg::{Anchor, Scale, Svg, round_step, tick_text};
use crate::calibration::result::{CalibrationResult, HandEyeResult};
use crate::calibration::settings::PoseKind;
use crate::geometry::{Base, Camera, Pinhole, Point, Sensor, Target, Tcp, Transform};

const WIDTH: f64 = 470.0;
const HEIGHT: f64 = 440.0;
const LEFT: f64 = 50.0;
const TOP: f64 = 30.0;
/// Radius of the dot of a pose.
const DOT: f64 = 3.0;
const RIGHT: f64 = WIDTH - 12.0;
const BOTTOM: f64 = HEIGHT - 40.0;

/// Everything that is drawn, in `base`, m.
struct Scene {
    /// TCP and target (or camera, where that is carried) at each pose.
    stops: Vec<Stop>,
    /// What stands still: name and place.
    fixed: Vec<(String, Vector3<f64>)>,
    /// Apex and four corners of what the camera sees.
    sight: Option<[Vector3<f64>; 5]>,
    carried: &'static str,
}

struct Stop {
    hint: String,
    kind: PoseKind,
    tcp: Vector3<f64>,
    carried: Vector3<f64>,
}

/// Draws both views; `None` without a hand-eye result or robot poses.
pub(super) fn draw(result: &CalibrationResult) -> Option<Figure> {
    let scene = scene(result)?;
    let points = scene.points();
    let extent = |axis: usize| {
        let values = || points.iter().map(|p| p[axis]);
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let span = |axis: usize| extent(axis).1 - extent(axis).0;
    let largest = (0..3).map(span).fold(0.2, f64::max) * 1.12;
    if !largest.is_finite() {
        return None;
    }
    // From the side that shows more: x or y to the right.
    let sideways = if span(1) > span(0) { 1 } else { 0 };
    let middle = |axis: usize| (extent(axis).0 + extent(axis).1) / 2.0;
    let middle = [middle(0), middle(1), middle(2)];
    let top = View { axes: [0, 1], middle, largest };
    let side = View { axes: [sideways, 2], middle, largest };
    let caption = format!(
        "Cell in base, mm, from above and from the side; each dot is the {} at one pose, the thin line leads to its TCP.{}",
        scene.carried,
        if scene.sight.is_some() { " Shaded: what the reference camera sees, up to the target." } else { "" }
    );
    let seen_from = if sideways == 0 { "Side: x right, z up" } else { "Side: y right, z up" };
    let drawings = vec![top.draw(&scene, "Top: x right, y up"), side.draw(&scene, seen_from)];
    Some(Figure { caption, drawings, wide: false })
}

fn scene(result: &CalibrationResult) -> Option<Scene> {
    let hand_eye = result.hand_eye.as_ref()?;
    let poses = || result.poses.iter().filter_map(|p| Some((p, p.base_from_tcp?)));
    let board = &result.provenance.board;
    let size = [board.squares_x, board.squares_y].map(|n| f64::from(n) * board.square_m / 2.0);
    let centre: Point<Target> = Point::assume_frame([size[0], size[1], 0.0]);
    let stop = |carried: &dyn Fn(&Transform<Base, Tcp>) -> Vector3<f64>| -> Vec<Stop> {
        let stop = |(pose, base_from_tcp): (&crate::calibration::result::PoseResult, Transform<Base, Tcp>)| Stop {
            hint: format!("{} ({})", pose.pose_id, kind_name(pose.kind)),
            kind: pose.kind,
            tcp: base_from_tcp.iso().translation.vector,
            carried: carried(&base_from_tcp),
        };
        poses().map(stop).filter(|s| s.tcp.iter().chain(s.carried.iter()).all(|v| v.is_finite())).collect()
    };
    let mut scene = match (&hand_eye.base_from_camera, &hand_eye.tcp_from_target, &hand_eye.tcp_from_camera) {
        (Some(base_from_camera), Some(tcp_from_target), _) => {
            let stops = stop(&|base_from_tcp| (*base_from_tcp * (*tcp_from_target * centre)).coords_m());
            let sight = sight(result, hand_eye, base_from_camera, &stops);
            Scene { stops, fixed: static_cameras(result, hand_eye, base_from_camera), sight, carried: "target" }
        }
        (_, _, Some(tcp_from_camera)) => {
            let stops = stop(&|base_from_tcp| (*base_from_tcp * *tcp_from_camera).iso().translation.vector);
            let target = hand_eye.base_from_target.map(|t| ("target".to_owned(), (t * centre).coords_m()));
            Scene { stops, fixed: target.into_iter().collect(), sight: None, carried: "camera" }
        }
        _ => return None,
    };
    scene.fixed.push(("base".into(), Vector3::zeros()));
    scene.fixed.retain(|(_, p)| p.iter().all(|v| v.is_finite()));
    (!scene.stops.is_empty()).then_some(scene)
}

/// The reference camera, and the other one where the stereo pair was solved.
fn static_cameras(
    result: &CalibrationResult,
    hand_eye: &HandEyeResult,
    base_from_camera: &Transform<Base, Sensor>,
) -> Vec<(String, Vector3<f64>)> {
    let reference = hand_eye.reference_camera;
    let mut cameras = vec![(reference.to_string(), base_from_camera.iso().translation.vector)];
    if let Some(stereo) = &result.stereo {
        let (other, reference_from_other) = match reference {
            Camera::Event => (Camera::Rgb, *stereo.event_from_rgb.iso()),
            Camera::Rgb => (Camera::Event, stereo.event_from_rgb.iso().inverse()),
        };
        cameras.push((other.to_string(), (base_from_camera.iso() * reference_from_other).translation.vector));
    }
    cameras
}

/// Apex and far corners of the field of view, as deep as the mean target.
fn sight(
    result: &CalibrationResult,
    hand_eye: &HandEyeResult,
    base_from_camera: &Transform<Base, Sensor>,
    stops: &[Stop],
) -> Option<[Vector3<f64>; 5]> {
    let Pinhole { width, height, fx, fy, cx, cy, .. } = result.cameras.get(&hand_eye.reference_camera)?.pinhole();
    let camera_from_base = base_from_camera.inverse();
    let depths = stops.iter().map(|s| (camera_from_base * Point::assume_frame(s.carried.into())).xyz_m()[2]);
    let depth_m = depths.sum::<f64>() / stops.len() as f64;
    let corner = |[u, v]: [f64; 2]| {
        let ray = [(u - cx) / fx * depth_m, (v - cy) / fy * depth_m, depth_m];
        (*base_from_camera * Point::<Sensor>::assume_frame(ray)).coords_m()
    };
    let (w, h) = (f64::from(width) - 0.5, f64::from(height) - 0.5);
    let [a, b, c, d] = [[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]].map(corner);
    let sight = [base_from_camera.iso().translation.vector, a, b, c, d];
    let finite = sight.iter().all(|p| p.iter().all(|v| v.is_finite()));
    (depth_m > 0.0 && finite).then_some(sight)
}

impl Scene {
    fn points(&self) -> Vec<Vector3<f64>> {
        let stops = self.stops.iter().flat_map(|s| [s.tcp, s.carried]);
        let sight = self.sight.iter().flatten().copied();
        stops.chain(self.fixed.iter().map(|f| f.1)).chain(sight).collect()
    }
}

/// One projection along an axis of `base`.
struct View {
    /// Which axes go right and up.
    axes: [usize; 2],
    middle: [f64; 3],
    /// Extent of the drawing, m.
    largest: f64,
}

impl View {
    fn draw(&self, scene: &Scene, title: &str) -> String {
        let mut svg = Svg::new(WIDTH, HEIGHT);
        self.grid(&mut svg);
        svg.text("name", [LEFT, TOP - 10.0], Anchor::Start, title);
        if let Some(sight) = &scene.sight {
            let [apex, a, b, c, d] = sight.map(|p| self.at(p));
            for [p, q] in [[a, b], [b, c], [c, d], [d, a]] {
                svg.polygon("sight", &[apex, p, q]);
            }
        }
        for stop in &scene.stops {
            svg.line("arm", self.at(stop.tcp), self.at(stop.carried));
        }
        for stop in &scene.stops {
            svg.circle(stop_class(stop.kind), self.at(stop.carried), DOT, &stop.hint);
        }
        Self::legend(&mut svg, scene);
        self.fixed(&mut svg, scene);
        svg.finish(title)
    }

    fn at(&self, point: Vector3<f64>) -> [f64; 2] {
        let [right, up] = self.axes.map(|axis| point[axis]);
        let [x, y] = self.scales();
        [x.at(right), y.at(up)]
    }

    fn scales(&self) -> [Scale; 2] {
        let px_per_m = (RIGHT - LEFT).min(BOTTOM - TOP) / self.largest;
        let scale = |axis: usize, from: f64, to: f64| {
            let half_m = (to - from).abs() / px_per_m / 2.0;
            let middle = self.middle[axis];
            Scale { low: middle - half_m, high: middle + half_m, from, to }
        };
        [scale(self.axes[0], LEFT, RIGHT), scale(self.axes[1], BOTTOM, TOP)]
    }

    fn grid(&self, svg: &mut Svg) {
        let [x, y] = self.scales();
        // The same step on both axes: squares of the grid are squares of the cell.
        let step = round_step(self.largest / 7.0);
        let (across, up) = (x.every(step), y.every(step));
        let in_mm = |ticks: &[f64]| ticks.iter().map(|t| t * 1e3).collect::<Vec<_>>();
        for tick in &across {
            svg.line(if *tick == 0.0 { "zero" } else { "grid" }, [x.at(*tick), TOP], [x.at(*tick), BOTTOM]);
            let text = tick_text(tick * 1e3, &in_mm(&across));
            svg.text("tick", [x.at(*tick), BOTTOM + 15.0], Anchor::Middle, &text);
        }
        for tick in &up {
            svg.line(if *tick == 0.0 { "zero" } else { "grid" }, [LEFT, y.at(*tick)], [RIGHT, y.at(*tick)]);
            svg.text("tick", [LEFT - 6.0, y.at(*tick) + 4.0], Anchor::End, &tick_text(tick * 1e3, &in_mm(&up)));
        }
        let [right, upward] = self.axes.map(|axis| ["x", "y", "z"][axis]);
        svg.text("axis", [(LEFT + RIGHT) / 2.0, HEIGHT - 6.0], Anchor::Middle, &format!("{right}, mm"));
        svg.turned("axis", [12.0, (TOP + BOTTOM) / 2.0], Anchor::Middle, -90.0, &format!("{upward}, mm"));
    }

    /// Names the dots; room is kept for wide fonts.
    fn legend(svg: &mut Svg, scene: &Scene) {
        let mut x = RIGHT;
        for (kind, room) in [(PoseKind::Distance, 64.0), (PoseKind::HandEye, 72.0), (PoseKind::Intrinsics, 82.0)] {
            if scene.stops.iter().any(|s| s.kind == kind) {
                x -= room;
                svg.circle(stop_class(kind), [x, TOP - 14.0], DOT, "");
                svg.text("tick", [x + 8.0, TOP - 10.0], Anchor::Start, kind_name(kind));
            }
        }
    }

    /// What stands still, each with its name: the first to the right of its mark, the next to the left.
    fn fixed(&self, svg: &mut Svg, scene: &Scene) {
        for (i, (name, place)) in scene.fixed.iter().enumerate() {
            let [x, y] = self.at(*place);
            svg.rect(if name == "base" { "base" } else { "camera" }, [x - 4.0, y - 4.0], [8.0, 8.0], name);
            let to_left = i % 2 == 1 || x > RIGHT - 60.0;
            let (anchor, side) = if to_left { (Anchor::End, -8.0) } else { (Anchor::Start, 8.0) };
            svg.text("label", [x + side, y - 6.0], anchor, name);
        }
    }
}

fn stop_class(kind: PoseKind) -> &'static str {
    match kind {
        PoseKind::Intrinsics => "stop-intrinsics",
        PoseKind::HandEye => "stop-hand-eye",
        PoseKind::Distance => "stop-distance",
    }
}
