//! Where the arm was: samples from joint positions, or from transforms between named frames.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Translation3, Vector3};

use super::messages::{JointState, Placed};
use crate::config::{RobotTopic, StillRule};
use crate::geometry::kinematics::{Arm, Joints};
use crate::geometry::{Base, Flange, Tcp, Transform, rotation};

/// The arm at one moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct RobotAt {
    /// When, nanoseconds on the clock of the stamps.
    pub(super) stamp_ns: u64,
    /// Where the tool was.
    pub(super) base_from_tcp: Transform<Base, Tcp>,
    /// Joint positions, rad; absent where transforms were recorded.
    pub(super) joints_rad: Option<Joints>,
    /// Joint speeds, rad/s; absent where none were recorded.
    pub(super) speeds_rad_s: Option<Joints>,
}

/// A model of the arm and the names of its joints.
pub(super) struct Model {
    arm: Arm,
    names: [String; 6],
    flange_from_tcp: Transform<Flange, Tcp>,
}

impl Model {
    pub(super) fn new(arm: Arm, prefix: &str, flange_from_tcp: Transform<Flange, Tcp>) -> Self {
        let names = std::array::from_fn(|i| format!("{prefix}{}", arm.joints[i].name));
        Self { arm, names, flange_from_tcp }
    }

    /// The names of its joints.
    pub(super) fn names(&self) -> String {
        self.names.join(", ")
    }

    /// The arm as a message has it; `None` for one about other joints.
    pub(super) fn at(&self, state: &JointState) -> Option<RobotAt> {
        let place = |name: &String| state.names.iter().position(|found| found == name);
        let mut places = [0; 6];
        for (slot, name) in places.iter_mut().zip(&self.names) {
            *slot = place(name)?;
        }
        let of = |values: &[f64]| -> Option<Joints> {
            let found: Vec<f64> = places.iter().filter_map(|i| values.get(*i).copied()).collect();
            found.try_into().ok()
        };
        let joints_rad = of(&state.positions).filter(|joints| joints.iter().all(|q| q.is_finite()))?;
        Some(RobotAt { speeds_rad_s: of(&state.speeds), ..self.placed(state.stamp_ns, joints_rad) })
    }

    fn placed(&self, stamp_ns: u64, joints_rad: Joints) -> RobotAt {
        let base_from_tcp = self.arm.forward(&joints_rad) * self.flange_from_tcp;
        RobotAt { stamp_ns, base_from_tcp, joints_rad: Some(joints_rad), speeds_rad_s: None }
    }
}

/// Poses of one frame in its parent by their stamps, ns.
type Track = Vec<(u64, Isometry3<f64>)>;

/// Collects what the bag says about the arm.
pub(super) enum Watched {
    /// By joints.
    Joints {
        /// The arm.
        model: Box<Model>,
        /// Its samples.
        samples: Vec<RobotAt>,
    },
    /// By transforms; parent and poses of each child frame.
    Tf {
        /// Those that move.
        moving: BTreeMap<String, (String, Track)>,
        /// Those that never do.
        fixed: BTreeMap<String, (String, Isometry3<f64>)>,
    },
}

impl Watched {
    /// Takes a transform; `fixed` where it never changes.
    pub(super) fn place(&mut self, placed: Placed, is_fixed: bool) {
        let Self::Tf { moving, fixed } = self else { return };
        let Placed { stamp_ns, parent, child, parent_from_child } = placed;
        if is_fixed {
            fixed.insert(child, (parent, parent_from_child));
        } else {
            let of_child = moving.entry(child).or_insert_with(|| (parent.clone(), Vec::new()));
            of_child.0 = parent;
            of_child.1.push((stamp_ns, parent_from_child));
        }
    }

    /// The samples in order of time. The error says in words what is missing.
    pub(super) fn samples(self, topic: &RobotTopic) -> Result<Vec<RobotAt>, String> {
        let mut samples = match (self, topic) {
            (Self::Joints { model, samples }, _) if samples.is_empty() => {
                return Err(format!("has no message with the joints {}; is `prefix` right?", model.names()));
            }
            (Self::Joints { samples, .. }, _) => samples,
            (Self::Tf { moving, fixed }, RobotTopic::Tf { base, tcp, .. }) => chain(moving, &fixed, base, tcp)?,
            (Self::Tf { .. }, RobotTopic::Joints { .. }) => Vec::new(),
        };
        samples.sort_by_key(|sample| sample.stamp_ns);
        samples.dedup_by_key(|sample| sample.stamp_ns);
        Ok(samples)
    }
}

/// One step of the way from base to tcp.
enum Step {
    Fixed(Isometry3<f64>),
    /// In order of time.
    Moving(Vec<(u64, Isometry3<f64>)>),
}

impl Step {
    /// Where the frame was at a time; `None` outside what was recorded.
    fn at(&self, stamp_ns: u64) -> Option<Isometry3<f64>> {
        let poses = match self {
            Self::Fixed(pose) => return Some(*pose),
            Self::Moving(poses) => poses,
        };
        let after = poses.partition_point(|(at, _)| *at < stamp_ns);
        let (next_ns, next) = poses.get(after)?;
        if *next_ns == stamp_ns {
            return Some(*next);
        }
        let (last_ns, last) = poses.get(after.checked_sub(1)?)?;
        let fraction = (stamp_ns - last_ns) as f64 / (next_ns - last_ns) as f64;
        let at = last.translation.vector.lerp(&next.translation.vector, fraction);
        let turn = rotation::interpolate(&last.rotation, &next.rotation, fraction);
        Some(Isometry3::from_parts(Translation3::from(at), turn))
    }
}

/// The tool in the base whenever the step of the way that is told most often was told.
fn chain(
    mut moving: BTreeMap<String, (String, Track)>,
    fixed: &BTreeMap<String, (String, Isometry3<f64>)>,
    base: &str,
    tcp: &str,
) -> Result<Vec<RobotAt>, String> {
    let (base, tcp) = (base.trim_start_matches('/'), tcp.trim_start_matches('/'));
    let known: Vec<String> = moving.keys().chain(fixed.keys()).cloned().collect();
    let mut steps = Vec::new();
    let mut frame = tcp.to_owned();
    while frame != base {
        let step = match (moving.remove(&frame), fixed.get(&frame)) {
            (Some((parent, mut poses)), _) => {
                poses.sort_by_key(|(at, _)| *at);
                Some((parent, Step::Moving(poses)))
            }
            (None, Some((parent, pose))) if steps.len() <= known.len() => Some((parent.clone(), Step::Fixed(*pose))),
            (None, _) => None,
        };
        let Some((parent, step)) = step else {
            let some = super::super::some_of(&known);
            return Err(format!(
                "no way from `{tcp}` up to `{base}`: nothing says where `{frame}` is; the frames are {some}"
            ));
        };
        steps.push(step);
        frame = parent;
    }
    let stamps = |step: &Step| if let Step::Moving(poses) = step { poses.len() } else { 0 };
    let Some(Step::Moving(most)) = steps.iter().max_by_key(|step| stamps(step)) else {
        return Err(format!("nothing between `{base}` and `{tcp}` ever moves; name the frames of the arm"));
    };
    let at = |&(stamp_ns, _): &(u64, Isometry3<f64>)| {
        let base_from_tcp = steps.iter().try_fold(Isometry3::identity(), |sum, step| Some(step.at(stamp_ns)? * sum))?;
        // The file names the two frames.
        let base_from_tcp = Transform::assume_frames(base_from_tcp);
        Some(RobotAt { stamp_ns, base_from_tcp, joints_rad: None, speeds_rad_s: None })
    };
    Ok(most.iter().filter_map(at).collect())
}

/// The times during which the arm stood still, nanoseconds: every stretch of `hold_s` within keeps the limits.
pub(super) fn still(samples: &[RobotAt], rule: &StillRule) -> Vec<[u64; 2]> {
    let (hold_ns, gap_ns) = ((rule.hold_s * 1e9) as u64, (rule.max_gap_s * 1e9) as u64);
    let mut found: Vec<[u64; 2]> = Vec::new();
    // Since this sample there was no gap and no joint too fast.
    let mut run = 0;
    for (i, now) in samples.iter().enumerate() {
        let gap = i > 0 && now.stamp_ns - samples[i - 1].stamp_ns > gap_ns;
        let slow = |speeds: Joints| speeds.iter().all(|speed| speed.abs() <= rule.joint_speed_rad_s);
        if !now.speeds_rad_s.is_none_or(slow) {
            run = i + 1;
            continue;
        }
        if gap {
            run = i;
        }
        let first = samples[..=i].partition_point(|sample| sample.stamp_ns + hold_ns < now.stamp_ns);
        // The sample before reaches back over the whole time.
        let Some(first) = first.checked_sub(1).filter(|first| *first >= run) else { continue };
        if !samples[first..i].iter().all(|then| near(then, now, rule)) {
            continue;
        }
        let begin_ns = samples[first].stamp_ns;
        match found.last_mut() {
            Some([_, to_ns]) if *to_ns >= begin_ns => *to_ns = now.stamp_ns,
            _ => found.push([begin_ns, now.stamp_ns]),
        }
    }
    found
}

fn near(a: &RobotAt, b: &RobotAt, rule: &StillRule) -> bool {
    match (a.joints_rad, b.joints_rad) {
        (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() <= rule.joint_spread_rad),
        _ => {
            a.base_from_tcp.distance_to_m(&b.base_from_tcp) <= rule.tcp_spread_m
                && a.base_from_tcp.angle_to_rad(&b.base_from_tcp) <= rule.tcp_turn_rad
        }
    }
}

/// The mean of the samples in a time, and how many there are; `None` without any.
pub(super) fn mean(samples: &[RobotAt], [from_ns, to_ns]: [u64; 2]) -> Option<RobotAt> {
    let inside: Vec<&RobotAt> = samples.iter().filter(|s| (from_ns..=to_ns).contains(&s.stamp_ns)).collect();
    let first = inside.first()?;
    let count = inside.len() as f64;
    let mut at = Vector3::zeros();
    let mut turn = Vector3::zeros();
    let mut joints = [0.0; 6];
    for sample in &inside {
        at += sample.base_from_tcp.iso().translation.vector / count;
        // Small turns add like vectors.
        turn +=
            rotation::to_vector(&(first.base_from_tcp.rotation().inverse() * sample.base_from_tcp.rotation())) / count;
        for (sum, q) in joints.iter_mut().zip(sample.joints_rad.unwrap_or_default()) {
            *sum += q / count;
        }
    }
    let rotation = first.base_from_tcp.rotation() * rotation::from_vector(turn.into());
    Some(RobotAt {
        stamp_ns: from_ns,
        base_from_tcp: Transform::from_parts(at.into(), rotation),
        joints_rad: first.joints_rad.map(|_| joints),
        speeds_rad_s: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: StillRule = StillRule {
        hold_s: 0.5,
        max_gap_s: 0.2,
        joint_speed_rad_s: 0.01,
        joint_spread_rad: 0.001,
        tcp_spread_m: 2e-4,
        tcp_turn_rad: 1e-3,
    };

    /// At 100 Hz; the first joint goes as `joint` says.
    fn samples(count: u64, joint: impl Fn(f64) -> f64, with_joints: bool) -> Vec<RobotAt> {
        let at = |n: u64| {
            let joints = [joint(n as f64 * 0.01), -1.0, 1.0, 0.0, 0.0, 0.0];
            let base_from_tcp = Arm::ur5e().forward(&joints) * Transform::identity();
            let joints_rad = with_joints.then_some(joints);
            RobotAt { stamp_ns: n * 10_000_000, base_from_tcp, joints_rad, speeds_rad_s: None }
        };
        (0..count).map(at).collect()
    }

    fn milliseconds(found: &[[u64; 2]]) -> Vec<[u64; 2]> {
        found.iter().map(|t| t.map(|ns| ns / 1_000_000)).collect()
    }

    #[test]
    fn a_rest_is_one_stop_and_a_slow_creep_none() {
        // Rests to 1 s, moves by 0.1 rad to 2 s, rests again with the noise of encoders.
        let joint = |t: f64| 0.1 * (t - 1.0).clamp(0.0, 1.0) + 1e-4 * (t * 977.0).sin();
        for with_joints in [true, false] {
            let found = milliseconds(&still(&samples(400, joint, with_joints), &RULE));
            let [[a, b], [c, d]] = found.as_slice() else { panic!("{found:?}") };
            // 0.1 rad/s leaves the limits, 1 mrad or 0.2 mm, within 10 ms.
            assert!(*a == 0 && b.abs_diff(1000) < 20, "{found:?}");
            assert!(c.abs_diff(2000) < 20 && *d == 3990, "{found:?}");
        }
        // 4 mrad/s are 2 mrad in half a second.
        assert!(still(&samples(400, |t| 0.004 * t, true), &RULE).is_empty());
    }

    #[test]
    fn gaps_and_speeds_end_a_rest() {
        let mut all = samples(200, |_| 0.3, true);
        all.drain(80..120);
        assert_eq!(milliseconds(&still(&all, &RULE)), [[0, 790], [1200, 1990]]);
        let mut fast = samples(200, |_| 0.3, true);
        fast[100].speeds_rad_s = Some([0.0, 0.0, 0.0, 0.02, 0.0, 0.0]);
        fast[101].speeds_rad_s = Some([f64::NAN; 6]);
        assert_eq!(milliseconds(&still(&fast, &RULE)), [[0, 990], [1020, 1990]]);
        assert!(still(&samples(40, |_| 0.3, true), &RULE).is_empty(), "shorter than hold_s");
    }

    #[test]
    fn transforms_are_chained_and_interpolated() {
        let mut watched = Watched::Tf { moving: BTreeMap::new(), fixed: BTreeMap::new() };
        let mut put = |parent: &str, child: &str, stamp_ns, x: f64, fixed| {
            let parent_from_child = Isometry3::translation(x, 0.0, 0.0);
            watched.place(Placed { stamp_ns, parent: parent.into(), child: child.into(), parent_from_child }, fixed);
        };
        for n in 0..5_u64 {
            put("base", "a", n * 100, n as f64, false);
        }
        // Told rarely, and not from the start on.
        put("a", "b", 50, 10.0, false);
        put("a", "b", 350, 40.0, false);
        put("b", "tool", 0, 0.5, true);
        let topic = RobotTopic::Tf {
            topic: String::new(),
            static_topic: String::new(),
            base: "/base".into(),
            tcp: "tool".into(),
        };
        let found = watched.samples(&topic).unwrap();
        let x: Vec<_> = found.iter().map(|s| (s.stamp_ns, s.base_from_tcp.translation_m()[0])).collect();
        assert_eq!(x, [(100, 16.5), (200, 27.5), (300, 38.5)]);
        let loose = Watched::Tf { moving: BTreeMap::new(), fixed: BTreeMap::new() };
        assert!(loose.samples(&topic).unwrap_err().contains("nothing says where `tool` is"));
    }

    #[test]
    fn the_mean_of_turns_is_between_them() {
        let turned = |angle: f64| RobotAt {
            stamp_ns: 5,
            base_from_tcp: Transform::from_pose_vector([angle, 0.0, 0.0, 0.0, std::f64::consts::PI - angle, 0.0]),
            joints_rad: None,
            speeds_rad_s: None,
        };
        // About a half turn, where rotation vectors change their sign.
        let mean = mean(&[turned(-1e-4), turned(3e-4)], [0, 10]).unwrap().base_from_tcp;
        assert!(mean.distance_to_m(&turned(1e-4).base_from_tcp) < 1e-12);
        assert!(mean.angle_to_rad(&turned(1e-4).base_from_tcp) < 1e-9);
    }
}
