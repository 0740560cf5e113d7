//! Trajectory files as text: poses that were taught by hand, written so that people can edit them.
//!
//! Writes text only; what it writes, [`super::parse_trajectory`] reads back to 1e-8 rad.

use std::fmt::Write as _;

use super::error::ConfigError;
use super::parse_trajectory;
use super::trajectory::Segment;
use crate::geometry::{Base, Tcp, Transform, kinematics::Joints};

/// A pose that was shown with the arm itself.
#[derive(Debug, Clone, PartialEq)]
pub struct TaughtPose {
    /// Id in the trajectory: letters, digits, `-` and `_`.
    pub name: String,
    /// Measured joint positions, rad, each inside -2 pi to 2 pi.
    pub joints_rad: Joints,
    /// Where the controller saw the TCP; becomes a comment.
    pub base_from_tcp: Transform<Base, Tcp>,
}

/// Why poses cannot be added to a trajectory file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AppendError {
    /// The file is wrong as it is, or an id is doubled.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Poses would end up somewhere else.
    #[error("{file}: cannot be extended at its end, where its last segment must be; teach into a new file instead")]
    Layout {
        /// The file as the caller named it.
        file: String,
    },
}

/// Whether this may be the id of a pose or the name of a trajectory: 1 to 64 letters, digits, `-` and `_`, and
/// no infinite number or NaN, which YAML reads even where it is quoted.
pub fn is_name(name: &str) -> bool {
    let fine = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let number = matches!(name.trim_start_matches('-').to_ascii_lowercase().as_str(), "nan" | "inf" | "infinity");
    (1..=64).contains(&name.len()) && name.chars().all(fine) && !number
}

/// The text of a trajectory file with these poses; each line of `header` becomes a comment at the top.
///
/// Names that are not allowed are quoted, so that reading the text back refuses them and nothing else changes.
pub fn trajectory_yaml(name: &str, poses: &[TaughtPose], header: &[String]) -> String {
    let mut text = String::from("# yaml-language-server: $schema=../.schema/trajectory.json\n");
    push_comments(&mut text, "", header);
    text.push_str(&format!("name: {}\nsegments:\n", scalar(name)));
    push_segment(&mut text, "  ", poses, &[]);
    text
}

/// The text of a trajectory file, extended by a segment with these poses; everything else stays as it is.
///
/// `file` is its name in messages. The result is read back and compared before it is returned.
pub fn append_yaml(text: &str, file: &str, poses: &[TaughtPose], header: &[String]) -> Result<String, AppendError> {
    let before = parse_trajectory(text, file)?;
    let mut extended = text.trim_end().to_owned();
    extended.push('\n');
    push_segment(&mut extended, indent_of_segments(text), poses, header);
    let alone = parse_trajectory(&trajectory_yaml(&before.name, poses, &[]), file)?;
    let wanted: Vec<Segment> = before.segments.into_iter().chain(alone.segments).collect();
    // A text that is fine in itself but not together: flow style, or an id that the file has already.
    match parse_trajectory(&extended, file) {
        Ok(after) if after.name == before.name && after.segments == wanted => Ok(extended),
        Err(error) if error.problems.iter().any(|p| p.message.contains("ids must differ")) => Err(error.into()),
        Ok(_) | Err(_) => Err(AppendError::Layout { file: file.into() }),
    }
}

/// What stands before the `-` of the last segment.
fn indent_of_segments(text: &str) -> &str {
    let indent = |line: &'_ str| line.len() - line.trim_start_matches(' ').len();
    let last = text.lines().rfind(|line| line.trim_start_matches(' ').starts_with("- pattern"));
    last.map_or("  ", |line| &line[..indent(line)])
}

fn push_segment(text: &mut String, indent: &str, poses: &[TaughtPose], header: &[String]) {
    push_comments(text, indent, header);
    text.push_str(&format!("{indent}- pattern: joints\n{indent}  poses:\n"));
    for TaughtPose { name, joints_rad, base_from_tcp } in poses {
        let [x, y, z] = base_from_tcp.translation_m().map(|v| fixed(v * 1e3, 3));
        let [rx, ry, rz] = base_from_tcp.rotation_vector_rad().map(|v| fixed(v.to_degrees(), 3));
        let joints = joints_rad.map(|q| fixed(q.to_degrees(), 6)).join(", ");
        let name = scalar(name);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{indent}    # TCP at ({x}, {y}, {z}) mm, rotation vector ({rx}, {ry}, {rz}) deg");
        let _ = writeln!(text, "{indent}    - {{id: {name}, joints_deg: [{joints}]}}");
    }
}

/// Each line as a comment, whatever is in it.
pub(super) fn push_comments(text: &mut String, indent: &str, lines: &[String]) {
    for line in lines.iter().flat_map(|l| l.split(['\n', '\r', '\u{85}', '\u{2028}', '\u{2029}'])) {
        let plain: String = line.chars().map(|c| if is_printable(c) { c } else { '?' }).collect();
        let _ = writeln!(text, "{indent}# {}", plain.trim_end());
    }
}

fn is_printable(c: char) -> bool {
    !c.is_control() && c != '\u{feff}' && c != '\u{fffe}' && c != '\u{ffff}'
}

/// The number with so many decimals, without a minus before zero.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let zero = text.strip_prefix('-').filter(|rest| rest.bytes().all(|b| b == b'0' || b == b'.'));
    zero.map_or(text.clone(), str::to_owned)
}

/// A YAML scalar that is read back as this text and nothing else.
pub(super) fn scalar(text: &str) -> String {
    let words = ["y", "n", "yes", "no", "on", "off", "true", "false", "null"];
    let begins = text.starts_with(|c: char| c.is_ascii_alphabetic());
    if is_name(text) && begins && !words.contains(&text.to_ascii_lowercase().as_str()) {
        return text.to_owned();
    }
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            ' '..='~' => quoted.push(c),
            other => quoted.push_str(&format!("\\U{:08x}", u32::from(other))),
        }
    }
    quoted + "\""
}

#[cfg(test)]
mod tests {
    use super::super::{Motion, Pattern};
    use super::*;
    use std::f64::consts::PI;

    fn pose(name: &str, joints_rad: Joints) -> TaughtPose {
        let base_from_tcp = Transform::from_pose_vector([0.4, -0.1234567, 0.3, PI, 0.0, -1e-9]);
        TaughtPose { name: name.into(), joints_rad, base_from_tcp }
    }

    fn joints_of(text: &str) -> Vec<(Option<String>, Joints)> {
        let trajectory = parse_trajectory(text, "t.yaml").unwrap_or_else(|e| panic!("{e}\n{text}"));
        let stops = trajectory.segments.into_iter().flat_map(|segment| match segment.pattern {
            Pattern::Joints(stops) => stops,
            other => panic!("{other:?}"),
        });
        stops.map(|stop| (stop.id, stop.at)).collect()
    }

    #[test]
    fn what_is_written_is_read_back_to_1e_8_rad() {
        let mut seed = 7u64;
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 * 4.0 * PI - 2.0 * PI
        };
        let awkward = [[0.0; 6], [-0.0, 1e-12, -1e-12, PI, -PI, 2.0 * PI], [-2.0 * PI, 1e-8, -1e-8, 0.1, 0.2, 0.3]];
        let drawn = (0..500).map(|_| std::array::from_fn(|_| random()));
        let poses: Vec<_> =
            awkward.into_iter().chain(drawn).enumerate().map(|(i, q)| pose(&format!("p{i}"), q)).collect();
        let text = trajectory_yaml("mine", &poses, &["taught\n- pattern: tcp".into(), "\u{7}".into()]);
        let found = joints_of(&text);
        assert_eq!(found.len(), poses.len());
        for (pose, (id, joints)) in poses.iter().zip(found) {
            assert_eq!(id.as_deref(), Some(pose.name.as_str()));
            let worst = pose.joints_rad.iter().zip(joints).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst <= 1e-8, "{worst:e} {pose:?}");
        }
        assert!(!text.contains("-0.000000,"), "a minus before zero");
        assert!(text.contains("\n# - pattern: tcp\n"), "a line end in the header leaves the comment");
    }

    #[test]
    fn the_text_is_what_a_person_would_write() {
        let text = trajectory_yaml("mine", &[pose("up", [0.5; 6])], &["by hand".into()]);
        let wanted = "\
# yaml-language-server: $schema=../.schema/trajectory.json
# by hand
name: mine
segments:
  - pattern: joints
    poses:
      # TCP at (400.000, -123.457, 300.000) mm, rotation vector (180.000, 0.000, 0.000) deg
      - {id: up, joints_deg: [28.647890, 28.647890, 28.647890, 28.647890, 28.647890, 28.647890]}
";
        assert_eq!(text, wanted);
        assert_eq!(parse_trajectory(&text, "t").unwrap().segments[0].motion, Motion::Joint);
    }

    #[test]
    fn a_name_is_read_back_or_refused_and_never_becomes_something_else() {
        let fine = ["p01", "1", "-", "null", "true", "NO", "1e3", "0x1f", "12_3", "_", "-1", "y", "p-inf", "info"]
            .map(str::to_owned);
        let hostile = [
            "",
            "a b",
            "a: b",
            "]",
            "}, {id: b",
            "#",
            "a\nb",
            "\"",
            "\\",
            "'",
            "\u{85}",
            "\u{2028}",
            "\u{0}",
            "\u{7f}",
            "\u{feff}",
            "ä",
            "\u{1f600}",
            "&a",
            "*a",
            "!t",
            "%",
            "@",
            "`",
            ".nan",
            "nan",
            "-INF",
            "infinity",
            "a.b",
            "- x",
        ]
        .map(str::to_owned);
        let long = ["x".repeat(64), "x".repeat(65)];
        for name in fine.iter().chain(&hostile).chain(&long) {
            let read = parse_trajectory(&trajectory_yaml("t", &[pose(name, [0.1; 6])], &[]), "t.yaml");
            assert_eq!(read.is_ok(), is_name(name), "{name:?}: {read:?}");
            let ids = |t: &super::super::Trajectory| match &t.segments[..] {
                [Segment { pattern: Pattern::Joints(stops), .. }] if stops.len() == 1 => stops[0].id.clone(),
                _ => None,
            };
            match read {
                Ok(trajectory) => assert_eq!(ids(&trajectory).as_ref(), Some(name)),
                Err(error) => assert!(error.problems.len() == 1 && error.to_string().contains("].id is"), "{error}"),
            }
            let of_file = parse_trajectory(&trajectory_yaml(name, &[pose("a", [0.1; 6])], &[]), "t.yaml");
            assert_eq!(of_file.map(|t| t.name).ok().as_ref(), is_name(name).then_some(name), "{name:?}");
        }
    }

    #[test]
    fn poses_are_appended_and_the_rest_stays() {
        let first = trajectory_yaml("mine", &[pose("a", [0.1; 6])], &[]);
        let second = append_yaml(&first, "t.yaml", &[pose("b", [0.2; 6])], &["later".into()]).unwrap();
        assert!(second.starts_with(&first) && second.contains("  # later\n"), "{second}");
        let third = append_yaml(&second, "t.yaml", &[pose("c", [0.3; 6])], &[]).unwrap();
        let ids: Vec<_> = joints_of(&third).into_iter().filter_map(|(id, _)| id).collect();
        assert_eq!(ids, ["a", "b", "c"]);
        let unindented = "name: x\nsegments:\n- pattern: joints\n  poses:\n  - joints_deg: [0, 0, 0, 0, 0, 0]  # here";
        let extended = append_yaml(unindented, "t.yaml", &[pose("b", [0.2; 6])], &[]).unwrap();
        assert_eq!(joints_of(&extended).len(), 2, "{extended}");
    }

    #[test]
    fn a_file_that_cannot_be_extended_is_refused() {
        let flow = "{name: x, segments: [{pattern: joints, poses: [{joints_deg: [0, 0, 0, 0, 0, 0]}]}]}\n";
        let error = append_yaml(flow, "t.yaml", &[pose("b", [0.2; 6])], &[]).unwrap_err();
        assert_eq!(error, AppendError::Layout { file: "t.yaml".into() });
        let name_last = "segments:\n  - pattern: joints\n    poses:\n    - joints_deg: [0, 0, 0, 0, 0, 0]\nname: x\n";
        assert!(append_yaml(name_last, "t.yaml", &[pose("b", [0.2; 6])], &[]).is_err());
        let first = trajectory_yaml("mine", &[pose("a", [0.1; 6])], &[]);
        let doubled = append_yaml(&first, "t.yaml", &[pose("a", [0.2; 6])], &[]).unwrap_err();
        assert!(doubled.to_string().contains("ids must differ"), "{doubled}");
        assert!(append_yaml("name: [", "t.yaml", &[pose("a", [0.2; 6])], &[]).is_err());
    }
}
