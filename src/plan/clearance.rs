//! What the arm and all that it carries keep from the keep-out boxes: when planning, and at run time.
//!
//! Every part is a capsule (a line with a radius): the links, the shapes in `robot.tool`, the TCP as a point, and the
//! display as a plate or each camera as a ball. A path is clear when every part is shown to stay farther than
//! `robot.keep_out_margin_mm` from every box all along, not at samples: see [`Clearance::joint_path`].
//!
//! The base stands still and is not tested. The shoulder, which only turns in place, is not tested against boxes that
//! the base stands in, or on with less than the margin between: pedestal, table. The upper arm is: with a margin of
//! 85 mm or more it is never clear of a table that the base stands on, and a smaller margin is needed.

use nalgebra::{Isometry3, Point3, Vector3};

use super::Refusal;
use super::reach::{limits_rad, within};
use super::way;
use crate::config::{Cell, KeepOut, Mount};
use crate::geometry::{
    Base, Camera, Capsule, Flange, Point, Target, Tcp, Transform,
    kinematics::{Arm, Joints, Link, Outline},
};

/// A path is refused where a part cannot be shown to be clear by looking every half millimetre, metres.
const FINEST_M: f64 = 0.5e-3;
/// The edge of a display around its board, and half of its thickness, metres.
const BEZEL_M: f64 = 0.015;
/// Radius of the ball that holds a camera, around its optical centre, metres.
const CAMERA_RADIUS_M: f64 = 0.05;
/// A calibrated arm carries its flange this near to where the nominal one would, metres.
const CALIBRATED_M: f64 = 0.02;

/// What tells whether positions and paths of the arm are clear and within the joint limits.
///
/// Owns all it needs: make it once, ask it at any time.
#[derive(Debug, Clone, PartialEq)]
pub struct Clearance {
    arm: Arm,
    /// The arm whose joint frames the links are in.
    links_of: Arm,
    flange_from_tcp: Transform<Flange, Tcp>,
    limits_rad: [[f64; 2]; 6],
    boxes: Vec<KeepOut>,
    margin_m: f64,
    parts: Vec<Part>,
    pairs: Vec<Pair>,
}

/// A capsule that moves with the arm.
#[derive(Debug, Clone, PartialEq)]
struct Part {
    name: String,
    on: On,
    from_m: [f64; 3],
    to_m: [f64; 3],
    radius_m: f64,
    /// A turn of one radian of each joint moves no point of its axis farther than this, metres.
    levers_m: [f64; 6],
}

/// What a part is fixed to.
#[derive(Debug, Clone, Copy, PartialEq)]
enum On {
    /// The link after this many joints.
    Link(usize),
    Flange,
}

/// A part and a box that it must not enter, by index.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pair {
    part: usize,
    keep_out: usize,
}

/// How near the arm comes to a box.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// The part that is nearest.
    pub part: String,
    /// The box.
    pub keep_out: String,
    /// Free space between them, metres; negative inside.
    pub gap_m: f64,
}

impl Clearance {
    /// For the boxes, margin, tool and board or cameras of a cell.
    pub fn of(cell: &Cell, arm: &Arm) -> Self {
        let outline = Outline::of(arm);
        let levers = Levers::of(outline.arm());
        let mut parts: Vec<Part> = outline.links().iter().map(|link| levers.link(link)).collect();
        parts.extend(carried(cell).into_iter().map(|(name, ends, radius_m)| levers.on_flange(name, ends, radius_m)));
        let mut all = Self {
            arm: arm.clone(),
            links_of: outline.arm().clone(),
            flange_from_tcp: cell.robot.tcp_offset,
            limits_rad: limits_rad(cell, arm),
            boxes: cell.robot.keep_out.clone(),
            margin_m: cell.robot.keep_out_margin_m,
            parts,
            pairs: Vec::new(),
        };
        all.pairs = all.tested();
        all
    }

    /// Whether the arm may stand here.
    pub fn at(&self, joints_rad: &Joints) -> Result<(), Refusal> {
        within(joints_rad, &self.limits_rad, &self.arm)?;
        let frames = self.frames(joints_rad);
        self.pairs.iter().try_for_each(|pair| self.room_m(*pair, &frames).map(drop))
    }

    /// Whether the arm may go from one position to the other with all joints in step, as `movej` does.
    ///
    /// From the middle of a stretch no point of a part moves farther to either end than the turns of the joints times
    /// the longest levers that the part can have. While that is more than the room to a box, the stretch is halved;
    /// below half a millimetre the path is refused. So nothing passes between two looks, however thin it is.
    pub fn joint_path(&self, from: &Joints, to: &Joints) -> Result<(), Refusal> {
        within(from, &self.limits_rad, &self.arm)?;
        within(to, &self.limits_rad, &self.arm)?;
        self.stretch(from, to, &[0.0; 6], &self.pairs)
    }

    /// Whether the TCP may go straight from `from` to a pose (x, y, z in m and rotation vector in rad, in `base`), as
    /// `movel` does; the joint positions at the end.
    ///
    /// Between looks at most 5 mm and 3 degrees apart, joints are taken to go in step, plus twice as far as the
    /// neighbouring looks show that they bend away from that.
    pub fn linear_path(&self, from: &Joints, to_tcp_pose: [f64; 6]) -> Result<Joints, Refusal> {
        let to = Transform::from_pose_vector(to_tcp_pose);
        let way = way::linear(&self.arm, &self.flange_from_tcp, from, &to)?;
        self.along(&way)?;
        Ok(way.last().copied().unwrap_or(*from))
    }

    /// The part that is nearest to each box at these joint positions; parts that are not tested left out.
    pub fn gaps(&self, joints_rad: &Joints) -> Vec<Gap> {
        let frames = self.frames(joints_rad);
        let nearest = |(index, keep_out): (usize, &KeepOut)| {
            let gap = |pair: &Pair| Gap {
                part: self.parts[pair.part].name.clone(),
                keep_out: keep_out.name.clone(),
                gap_m: self.capsule(pair.part, &frames).gap_to_box_m(&keep_out.min_m, &keep_out.max_m),
            };
            let gaps = self.pairs.iter().filter(|pair| pair.keep_out == index).map(gap);
            gaps.min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
        };
        self.boxes.iter().enumerate().filter_map(nearest).collect()
    }

    /// Whether a straight way of the TCP is clear, from looks along it.
    pub(super) fn along(&self, way: &[Joints]) -> Result<(), Refusal> {
        way.iter().try_for_each(|joints_rad| within(joints_rad, &self.limits_rad, &self.arm).map(drop))?;
        for (ends, bend_rad) in way.windows(2).zip(bends_rad(way)) {
            self.stretch(&ends[0], &ends[1], &bend_rad, &self.pairs)?;
        }
        Ok(())
    }

    /// Every part against every box, except what stands where it stands.
    fn tested(&self) -> Vec<Pair> {
        let frames = self.frames(&[0.0; 6]);
        let bases: Vec<_> = (0..self.parts.len()).filter(|part| self.parts[*part].on == On::Link(0)).collect();
        let mut pairs = Vec::new();
        for (keep_out, shape) in self.boxes.iter().enumerate() {
            let base_gap_m = |base: &usize| self.capsule(*base, &frames).gap_to_box_m(&shape.min_m, &shape.max_m);
            let is_free_of_base = bases.iter().all(|base| base_gap_m(base) > self.margin_m);
            for (part, Part { on, .. }) in self.parts.iter().enumerate() {
                let stands = matches!(on, On::Link(0)) || (matches!(on, On::Link(1)) && !is_free_of_base);
                if !stands {
                    pairs.push(Pair { part, keep_out });
                }
            }
        }
        pairs
    }

    /// Looks at the middle between two positions, then at both halves, where need be.
    fn stretch(&self, from: &Joints, to: &Joints, bend_rad: &Joints, pairs: &[Pair]) -> Result<(), Refusal> {
        let middle: Joints = std::array::from_fn(|i| 0.5 * (from[i] + to[i]));
        let turns_rad: Joints = std::array::from_fn(|i| 0.5 * (to[i] - from[i]).abs());
        let frames = self.frames(&middle);
        let mut open = Vec::new();
        for pair in pairs {
            let part = &self.parts[pair.part];
            let room_m = self.room_m(*pair, &frames)?;
            let moves_m = part.moves_m(&turns_rad);
            let clear = room_m > moves_m + part.moves_m(bend_rad);
            if !clear && moves_m < FINEST_M {
                return Err(self.refusal(*pair, &frames));
            }
            if !clear {
                open.push(*pair);
            }
        }
        if open.is_empty() {
            return Ok(());
        }
        self.stretch(from, &middle, bend_rad, &open)?;
        self.stretch(&middle, to, bend_rad, &open)
    }

    /// Free space beyond the margin, metres; refused where there is none.
    fn room_m(&self, pair: Pair, frames: &Frames) -> Result<f64, Refusal> {
        let shape = &self.boxes[pair.keep_out];
        let room_m = self.capsule(pair.part, frames).gap_to_box_m(&shape.min_m, &shape.max_m) - self.margin_m;
        if room_m > 0.0 { Ok(room_m) } else { Err(self.refusal(pair, frames)) }
    }

    fn refusal(&self, pair: Pair, frames: &Frames) -> Refusal {
        let (part, shape) = (&self.parts[pair.part], &self.boxes[pair.keep_out]);
        let capsule = self.capsule(pair.part, frames);
        let nearest = capsule.axis_to_box(&shape.min_m, &shape.max_m);
        let (axis, face) = (nearest.on_axis.coords_m(), nearest.on_box.coords_m());
        // The point of the part that is nearest to the box, or in it.
        let share = (capsule.radius_m / nearest.distance_m.max(1e-12)).min(1.0);
        let at_m = (axis + (face - axis) * share).into();
        let gap_m = nearest.distance_m - capsule.radius_m;
        Refusal::KeepOut { name: shape.name.clone(), part: part.name.clone(), at_m, gap_m }
    }

    fn frames(&self, joints_rad: &Joints) -> Frames {
        Frames { links: self.links_of.joint_frames(joints_rad), flange: *self.arm.forward(joints_rad).iso() }
    }

    fn capsule(&self, part: usize, frames: &Frames) -> Capsule {
        let Part { on, from_m, to_m, radius_m, .. } = &self.parts[part];
        let frame = match on {
            On::Link(joints) => joints.checked_sub(1).and_then(|last| frames.links.get(last).copied()),
            On::Flange => Some(frames.flange),
        };
        let frame = frame.unwrap_or_else(Isometry3::identity);
        let in_base = |m: &[f64; 3]| Point::<Base>::assume_frame((frame * Point3::from(*m)).coords.into());
        Capsule { from: in_base(from_m), to: in_base(to_m), radius_m: *radius_m }
    }
}

/// Where everything that carries parts is.
struct Frames {
    links: [Isometry3<f64>; 6],
    flange: Isometry3<f64>,
}

impl Part {
    /// No point of the axis moves farther when the joints turn by these angles, metres.
    fn moves_m(&self, turns_rad: &Joints) -> f64 {
        self.levers_m.iter().zip(turns_rad).map(|(lever_m, turn_rad)| lever_m * turn_rad).sum()
    }
}

/// For each stretch of a way, how far a joint may leave the way in step between its looks, rad: twice what a parabola
/// through three looks does, by those before or those after, whichever bends more.
fn bends_rad(way: &[Joints]) -> Vec<Joints> {
    let of = |looks: &[Joints], joint: usize| (looks[0][joint] - 2.0 * looks[1][joint] + looks[2][joint]).abs() / 4.0;
    let around = |i: usize, joint: usize| {
        let looks = [i.checked_sub(1), Some(i)].into_iter().flatten().filter_map(|first| way.get(first..first + 3));
        looks.map(|looks| of(looks, joint)).fold(0.0, f64::max)
    };
    (0..way.len().saturating_sub(1)).map(|i| std::array::from_fn(|joint| around(i, joint))).collect()
}

/// Distances between the joints of an arm.
struct Levers {
    /// From each joint to the next one, and from the last one to the flange, metres.
    steps_m: [f64; 6],
}

impl Levers {
    fn of(arm: &Arm) -> Self {
        let next = |i: usize| arm.joints.get(i + 1).map_or(&arm.flange, |joint| &joint.origin);
        Self { steps_m: std::array::from_fn(|i| next(i).translation.vector.norm()) }
    }

    fn link(&self, link: &Link) -> Part {
        let &Link { name, joints, from_m, to_m, radius_m } = link;
        // Steps that lie between a joint and the frame of the link.
        let steps = joints.saturating_sub(1);
        self.part(name.into(), On::Link(joints), [from_m, to_m], radius_m, steps, 0.0)
    }

    fn on_flange(&self, name: String, ends_m: [[f64; 3]; 2], radius_m: f64) -> Part {
        self.part(name, On::Flange, ends_m, radius_m, 6, CALIBRATED_M)
    }

    fn part(&self, name: String, on: On, ends_m: [[f64; 3]; 2], radius_m: f64, steps: usize, more_m: f64) -> Part {
        let [from_m, to_m] = ends_m;
        let out_m = Vector3::from(from_m).norm().max(Vector3::from(to_m).norm()) + more_m;
        let joints = if let On::Link(joints) = on { joints } else { 6 };
        let lever_m =
            |i: usize| if i < joints { self.steps_m[i..steps.max(i)].iter().sum::<f64>() + out_m } else { 0.0 };
        Part { name, on, from_m, to_m, radius_m, levers_m: std::array::from_fn(lever_m) }
    }
}

/// Name, ends of the axis in the flange and radius of everything that the flange carries.
fn carried(cell: &Cell) -> Vec<(String, [[f64; 3]; 2], f64)> {
    let flange_from_tcp = cell.robot.tcp_offset;
    let tcp_m = flange_from_tcp.translation_m();
    let mut parts = vec![("TCP".to_owned(), [tcp_m, tcp_m], 0.0)];
    parts.extend(cell.robot.tool.iter().map(|tool| (tool.name.clone(), [tool.from_m, tool.to_m], tool.radius_m)));
    match cell.nominal.mount {
        Mount::Target { tcp_from_target, .. } => {
            let flange_from_target = flange_from_tcp * tcp_from_target;
            let rods = plate(cell.board.size_m());
            let in_flange =
                |xy: [f64; 2]| (flange_from_target * Point::<Target>::assume_frame([xy[0], xy[1], 0.0])).xyz_m();
            parts.extend(rods.into_iter().map(|ends| ("board".to_owned(), ends.map(in_flange), BEZEL_M)));
        }
        Mount::Cameras { tcp_from_camera, .. } => {
            for camera in Camera::BOTH.into_iter().filter(|camera| cell.nominal_camera(*camera).is_some()) {
                let Some(camera_from_reference) = cell.camera_from_reference(camera) else { continue };
                let flange_from_camera = flange_from_tcp * tcp_from_camera * camera_from_reference.inverse();
                let at_m = flange_from_camera.translation_m();
                parts.push((format!("{camera} camera"), [at_m, at_m], CAMERA_RADIUS_M));
            }
        }
    }
    parts
}

/// Axes, in the plane of the board, of rods along its longer side that together hold the display.
///
/// They lie at most a radius apart, so that between two of them the plate is still 0.87 radii thick to each side, and
/// reach a third of a radius past the board, so that the corners of the bezel are held too.
fn plate(size_m: [f64; 2]) -> Vec<[[f64; 2]; 2]> {
    let past_m = BEZEL_M / 3.0;
    let long = usize::from(size_m[1] > size_m[0]);
    let [length_m, width_m] = [size_m[long], size_m[1 - long]];
    let gaps = ((width_m + 2.0 * past_m) / BEZEL_M).ceil().clamp(1.0, 200.0);
    let rod = |i: u32| {
        let across_m = -past_m + (width_m + 2.0 * past_m) * f64::from(i) / gaps;
        [-past_m, length_m + past_m].map(|along_m| if long == 0 { [along_m, across_m] } else { [across_m, along_m] })
    };
    (0..=gaps as u32).map(rod).collect()
}

#[cfg(test)]
mod tests;
