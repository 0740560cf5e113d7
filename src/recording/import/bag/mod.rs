//! A bag: an MCAP file recorded by somebody else, with a map that says what its topics mean.
//!
//! It is read three times, never held whole: to survey it, to copy the packets of the event camera, to copy the images
//! of the poses. Everything is brought together by the stamps in the headers of the messages.

mod messages;
mod robot;
mod stops;
mod survey;
mod write;

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::error::{ImportError, Place};
use super::{ImportReport, Probe, some_of};
use crate::calibration::problem::{CameraSetup, CheckTruth};
use crate::config::{self, PairBy, RobotTopic, Topics, TopicsMode};
use crate::geometry::Camera;
use crate::geometry::kinematics::Arm;
use crate::image::GrayImage;
use crate::recording::Attachment;
use crate::recording::scan::{self, Channel};
use crate::recording::setup::{ImportSetup, ImportedPose};
use robot::Model;
use survey::Survey;

const LAYOUT: &str = "bag (MCAP with a map of its topics)";

/// Looks into images and makes them.
#[derive(Clone, Copy)]
pub struct Pictures<'a> {
    /// Says the size of an encoded image.
    pub probe: Probe<'a>,
    /// Encodes an image losslessly as PNG.
    pub encode: &'a dyn Fn(&GrayImage) -> Result<Vec<u8>, String>,
}

/// What the user says about a bag.
#[derive(Debug, Clone)]
pub struct BagOptions {
    /// The map of its topics; a URDF is sought beside it.
    pub map: PathBuf,
    /// Name of the data set; absent: that of the bag.
    pub name: Option<String>,
    /// The board; counts before the one in the map.
    pub board: Option<crate::board::Board>,
    /// Names the session.
    pub session_id: String,
}

/// Imports a bag into the new session file `output`, as [`super::import`] does with folders.
///
/// # Errors
/// [`ImportError`] where the map is wrong, does not fit the bag, or messages are of a kind that is not understood.
pub fn import_bag(
    bag: &Path,
    output: &Path,
    options: &BagOptions,
    pictures: Pictures<'_>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<ImportReport, ImportError> {
    super::write::check_output(output)?;
    let path = file_of(bag)?;
    let name = path.file_name().map_or_else(|| "the bag".into(), |name| name.to_string_lossy().into_owned());
    let (mut map, attachments) = read_map(options)?;
    if let Some(board) = &options.board {
        map.board = super::data_set::given_board(board)?;
    }
    let model = model(&map, &attachments)?;
    let survey = survey::survey(&path, &name, &map, model)?;
    let found = stops::find(&survey, &map, &name)?;
    let (paired_by_triggers, mut notices) = pairing(&survey, &map, &name)?;
    notices.extend(found.notices.iter().cloned());
    notices.extend(notes(&survey, &map));
    let setup = setup(&map, options, &path, &found.stops, paired_by_triggers);
    let bag = write::Bag { path: &path, name: &name, map: &map, survey: &survey, found: &found };
    bag.write(output, setup, attachments, &options.session_id, pictures, notices, progress)
}

/// Whether a file begins as an MCAP file does.
pub(super) fn is_mcap(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(64).read_to_end(&mut start));
    read.is_ok() && scan::is_mcap(&start)
}

/// The topics of a bag and what is on them, in words.
pub(super) fn topics(path: &Path) -> Result<String, ImportError> {
    let mut topics: BTreeMap<String, (String, usize)> = BTreeMap::new();
    survey::each_message(path, &path.display().to_string(), &mut |message| {
        let Channel { topic, schema, .. } = &*message.channel;
        match topics.get_mut(topic) {
            Some((_, count)) => *count += 1,
            None => drop(topics.insert(topic.clone(), (schema.clone(), 1))),
        }
        Ok(())
    })?;
    let named: Vec<String> =
        topics.iter().map(|(topic, (schema, count))| format!("{topic} ({schema}, {count} messages)")).collect();
    Ok(if named.is_empty() { "no messages".into() } else { named.join(", ") })
}

/// The file of a bag; rosbag2 puts it into a folder.
fn file_of(bag: &Path) -> Result<PathBuf, ImportError> {
    if bag.is_file() {
        return Ok(bag.into());
    }
    let names = super::names_in(bag)?;
    let mcap: Vec<&String> = names.iter().filter(|name| name.ends_with(".mcap")).collect();
    let place = Place::file(bag.display().to_string());
    match mcap.as_slice() {
        [one] => Ok(bag.join(one)),
        [] => {
            Err(place.wrong(format!("holds no .mcap file, found {}; other storage: convert the bag", some_of(&names))))
        }
        many => {
            Err(place.wrong(format!("holds more than one .mcap file ({}); merge a split bag first", some_of(many))))
        }
    }
}

/// The map, and the texts that belong to the session.
fn read_map(options: &BagOptions) -> Result<(Topics, Vec<Attachment>), ImportError> {
    let text_of = |path: &Path| {
        std::fs::read_to_string(path)
            .map_err(|why| Place::file(path.display().to_string()).wrong(format!("cannot be read: {why}")))
    };
    let text = text_of(&options.map)?;
    let map = config::parse_topics(&text, &options.map.display().to_string())?;
    let mut attachments = vec![Attachment { name: "topics.yaml".into(), data: text.into_bytes() }];
    if let Some(RobotTopic::Joints { urdf: Some(urdf), .. }) = &map.robot {
        let path = options.map.parent().unwrap_or(Path::new("")).join(urdf);
        attachments.push(Attachment { name: "robot.urdf".into(), data: text_of(&path)?.into_bytes() });
    }
    Ok((map, attachments))
}

/// The model of the arm, where joints are recorded.
fn model(map: &Topics, attachments: &[Attachment]) -> Result<Option<Model>, ImportError> {
    let Some(RobotTopic::Joints { prefix, urdf, flange_from_tcp, .. }) = &map.robot else { return Ok(None) };
    let text = attachments.iter().find(|a| a.name == "robot.urdf").map(|a| String::from_utf8_lossy(&a.data));
    let arm = match (text, urdf) {
        (Some(text), Some(urdf)) => Arm::from_urdf(&text).map_err(|why| Place::file(urdf).wrong(why.to_string()))?,
        _ => Arm::ur5e(),
    };
    Ok(Some(Model::new(arm, prefix, *flange_from_tcp)))
}

/// Whether events are cut by trigger edges, and what to say about it.
fn pairing(survey: &Survey, map: &Topics, name: &str) -> Result<(bool, Vec<String>), ImportError> {
    let Some(event) = &map.event else { return Ok((false, Vec::new())) };
    let rising = survey.rising_edges.get(&event.trigger_channel).copied().unwrap_or(0);
    let images = survey.images_ns.len();
    let enough = rising >= 3 && 2 * rising >= images;
    let (channel, topic) = (event.trigger_channel, &event.topic);
    match event.paired_by {
        PairBy::Arrival => Ok((false, Vec::new())),
        PairBy::Trigger if rising == 0 => {
            let others: Vec<String> = survey.rising_edges.iter().map(|(other, n)| format!("{n} on {other}")).collect();
            let others = if others.is_empty() { "none at all".into() } else { others.join(", ") };
            let what = format!(
                "has no rising edge on trigger channel {channel} (found {others}); correct event.trigger_channel, or say \
                 `paired_by: arrival`"
            );
            Err(survey::wrong(name, topic, &what))
        }
        PairBy::Trigger => Ok((true, Vec::new())),
        PairBy::Auto if enough => Ok((true, Vec::new())),
        PairBy::Auto => Ok((
            false,
            vec![format!(
                "{rising} rising edges on trigger channel {channel} for {images} images: images and events are paired by \
                 their stamps, good to some milliseconds"
            )],
        )),
    }
}

/// What is odd about a bag.
fn notes(survey: &Survey, map: &Topics) -> Vec<String> {
    let mut notes: Vec<String> = survey.damage.iter().map(|what| format!("the bag is damaged: {what}")).collect();
    if survey.lost_packets > 0 {
        notes.push(format!("{} packets of the event camera are missing in the bag", survey.lost_packets));
    }
    if let Some(event) = map.event.as_ref().filter(|_| survey.outside > 0) {
        notes.push(format!("{} events lie outside {} x {} pixels", survey.outside, event.width, event.height));
    }
    notes
}

fn setup(map: &Topics, options: &BagOptions, path: &Path, stops: &[stops::Stop], by_triggers: bool) -> ImportSetup {
    let camera = |width, height| CameraSetup { width, height, serial: None, lens: None, focal_px: None };
    let rgb = map.rgb.as_ref().map(|rgb| (Camera::Rgb, camera(rgb.width, rgb.height)));
    let event = map.event.as_ref().map(|event| (Camera::Event, camera(event.width, event.height)));
    let stem = path.file_stem().map_or_else(|| "bag".into(), |stem| stem.to_string_lossy().into_owned());
    let poses = match &map.robot {
        None => "no robot",
        Some(RobotTopic::Joints { urdf: None, .. }) => "robot poses from joint positions by the nominal UR5e",
        Some(RobotTopic::Joints { .. }) => "robot poses from joint positions by the URDF of the map",
        Some(RobotTopic::Tf { .. }) => "robot poses from transforms",
    };
    ImportSetup {
        name: options.name.clone().unwrap_or(stem),
        source: format!("{LAYOUT}; {poses}"),
        robot_poses: map.mode == TopicsMode::Handeye,
        carried: map.carried,
        board: map.board.clone(),
        cameras: rgb.into_iter().chain(event).collect::<BTreeMap<_, _>>(),
        exposure_s: map.rgb.as_ref().map(|rgb| rgb.exposure_s),
        image_period_s: map.rgb.as_ref().map(|rgb| 1.0 / rgb.images_per_s),
        trigger_channel: map.event.as_ref().filter(|_| by_triggers).map(|event| event.trigger_channel),
        arrivals: map.event.is_some(),
        poses: stops.iter().map(|stop| ImportedPose { id: stop.id.clone(), kind: stop.kind }).collect(),
        pairs: Vec::new(),
        checks: map.checks.map(|c| CheckTruth { corner_id: c.corner_id, target_to_tcp_m: c.target_to_tcp_m }),
    }
}
