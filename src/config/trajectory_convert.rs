//! From the keys of a trajectory file to a [`Trajectory`]: units, ids, and what one range cannot say.

use std::collections::BTreeSet;

use super::cell_convert::{check_name, metres};
use super::error::Findings;
use super::pose::{position_m, rotvec_in_rad};
use super::trajectory::{BoardView, Pair, Pattern, Ring, Segment, Start, Stop, Trajectory};
use super::trajectory_file::{PairFile, RingFile, SegmentFile, TrajectoryFile, ViewFile};
use crate::geometry::rotation;

pub(super) fn trajectory(file: TrajectoryFile, name_of_file: &str, findings: &mut Findings<'_>) -> Trajectory {
    check_name("name", &file.name, findings);
    if file.segments.is_empty() {
        findings.add("segments", "is empty: a trajectory needs at least one segment");
    }
    let mut convert = Convert { findings, ids: BTreeSet::new() };
    let numbered = file.segments.into_iter().enumerate();
    let segments = numbered.map(|(i, segment)| convert.segment(segment, &format!("segments[{i}]"))).collect();
    Trajectory { name: file.name, file: name_of_file.into(), segments }
}

struct Convert<'a, 'f> {
    findings: &'a mut Findings<'f>,
    /// The ids so far.
    ids: BTreeSet<String>,
}

impl Convert<'_, '_> {
    fn segment(&mut self, file: SegmentFile, path: &str) -> Segment {
        let (motion, purpose, camera) = match &file {
            SegmentFile::Joints(s) => (s.motion, s.purpose, None),
            SegmentFile::Tcp(s) => (s.motion, s.purpose, None),
            SegmentFile::Views(s) => (s.motion, s.purpose, s.camera),
            SegmentFile::Grid(s) => (s.motion, s.purpose, s.camera),
            SegmentFile::Depth(s) => (s.motion, s.purpose, s.camera),
            SegmentFile::Roll(s) => (s.motion, s.purpose, s.camera),
            SegmentFile::Sweep(s) => (s.motion, s.purpose, s.camera),
            SegmentFile::Orbit(s) => (s.motion, s.purpose, s.camera),
            SegmentFile::Translate(s) => (s.motion, s.purpose, s.camera),
        };
        Segment { motion, purpose, camera, pattern: self.pattern(file, path) }
    }

    fn pattern(&mut self, file: SegmentFile, path: &str) -> Pattern {
        match file {
            SegmentFile::Joints(s) => {
                let stops = s.poses.into_iter().map(|p| (p.id, p.joints_deg));
                Pattern::Joints(self.stops(stops, path, |_, joints, _| joints.map(f64::to_radians)))
            }
            SegmentFile::Tcp(s) => {
                let stops = s.poses.into_iter().map(|p| (p.id, p.pose));
                Pattern::Tcp(
                    self.stops(stops, path, |c, pose, path| pose.transform(&format!("{path}.pose"), c.findings)),
                )
            }
            SegmentFile::Views(s) => {
                let stops = s.poses.into_iter().map(|p| (p.id, p.view));
                Pattern::Views(self.stops(stops, path, |c, view, path| c.view(view, &format!("{path}.view"))))
            }
            SegmentFile::Grid(s) => Pattern::Grid {
                view: self.view(s.view, &format!("{path}.view")),
                columns: s.columns,
                rows: s.rows,
                step_m: s.step_mm.map(metres),
            },
            SegmentFile::Depth(s) => Pattern::Depth {
                view: self.view(s.view, &format!("{path}.view")),
                count: s.count,
                step_m: metres(s.step_mm),
            },
            SegmentFile::Roll(s) => Pattern::Roll {
                view: self.view(s.view, &format!("{path}.view")),
                count: s.count,
                step_rad: s.step_deg.to_radians(),
            },
            SegmentFile::Sweep(s) => Pattern::Sweep {
                from: self.view(s.from, &format!("{path}.from")),
                to: self.view(s.to, &format!("{path}.to")),
                count: s.count,
            },
            SegmentFile::Orbit(s) => {
                self.some(&s.rings, path, "rings");
                Pattern::Orbit { rings: s.rings.into_iter().map(ring).collect() }
            }
            SegmentFile::Translate(s) => {
                self.some(&s.pairs, path, "pairs");
                let numbered = s.pairs.into_iter().enumerate();
                Pattern::Translate(numbered.map(|(i, pair)| self.pair(pair, &format!("{path}.pairs[{i}]"))).collect())
            }
        }
    }

    fn some<T>(&mut self, items: &[T], path: &str, key: &str) {
        if items.is_empty() {
            self.findings.add(&format!("{path}.{key}"), "is empty: give at least one");
        }
    }

    fn stops<F, T>(
        &mut self,
        files: impl Iterator<Item = (Option<String>, F)>,
        path: &str,
        mut at: impl FnMut(&mut Self, F, &str) -> T,
    ) -> Vec<Stop<T>> {
        let mut stops = Vec::new();
        for (i, (id, file)) in files.enumerate() {
            let path = format!("{path}.poses[{i}]");
            if let Some(id) = &id {
                self.id(id, &format!("{path}.id"));
            }
            stops.push(Stop { id, at: at(self, file, &path) });
        }
        self.some(&stops, path, "poses");
        stops
    }

    fn id(&mut self, id: &str, path: &str) {
        check_name(path, id, self.findings);
        if !self.ids.insert(id.to_owned()) {
            self.findings.add(path, format!("is {id:?}, which an earlier pose has: ids must differ"));
        }
    }

    fn view(&mut self, file: ViewFile, path: &str) -> BoardView {
        let ViewFile { centre_m, centre_mm, rotvec_deg, rotvec_rad } = file;
        let centre_m = position_m("centre", centre_m, centre_mm, path, self.findings);
        if centre_m[2] <= 0.0 && (file.centre_m.is_some() || file.centre_mm.is_some()) {
            let key = if file.centre_m.is_some() { "centre_m" } else { "centre_mm" };
            self.findings.add(
                &format!("{path}.{key}[2]"),
                "is not before the camera: z points away from the camera and must be above 0",
            );
        }
        let rotvec_rad = rotvec_in_rad(rotvec_deg, rotvec_rad, path, self.findings).unwrap_or_default();
        BoardView { centre_m, rotation: rotation::from_vector(rotvec_rad) }
    }

    fn pair(&mut self, file: PairFile, path: &str) -> Pair {
        self.id(&file.name, &format!("{path}.name"));
        let displacement_m = file.displacement_mm.map(metres);
        let length_m = displacement_m.iter().map(|v| v * v).sum::<f64>().sqrt();
        let apart = length_m >= 1e-3;
        if !apart {
            self.findings.add(&format!("{path}.displacement_mm"), "is shorter than 1 mm: the two poses must differ");
        }
        let known_m = file.known_mm.map(metres);
        let near = known_m.is_none_or(|known| (known - length_m).abs() <= 0.002 + 0.05 * length_m);
        if !near {
            let (known, length) = (file.known_mm.unwrap_or_default(), length_m * 1e3);
            self.findings.add(
                &format!("{path}.known_mm"),
                format!("is {known}, but the displacement is {length:.3} mm long: they mean the same distance"),
            );
        }
        Pair { name: file.name, start: self.start(&file.start, &format!("{path}.start")), displacement_m, known_m }
    }

    fn start(&mut self, file: &super::trajectory_file::StartFile, path: &str) -> Start {
        match (file.view, file.tcp) {
            (Some(view), None) => Start::View(self.view(view, &format!("{path}.view"))),
            (None, Some(tcp)) => Start::Tcp(tcp.transform(&format!("{path}.tcp"), self.findings)),
            (Some(_), Some(_)) | (None, None) => {
                self.findings.add(path, "must have one of `view` and `tcp`");
                Start::Tcp(crate::geometry::Transform::identity())
            }
        }
    }
}

fn ring(file: RingFile) -> Ring {
    let [right, down] = file.offset_mm.map(metres);
    let rolls_rad: Vec<f64> = file.rolls_deg.iter().map(|deg| deg.to_radians()).collect();
    Ring {
        centre_m: [right, down, metres(file.distance_mm)],
        tilt_rad: file.tilt_deg.to_radians(),
        count: file.count,
        first_azimuth_rad: file.first_azimuth_deg.to_radians(),
        rolls_rad: if rolls_rad.is_empty() { vec![0.0] } else { rolls_rad },
    }
}
