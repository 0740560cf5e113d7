//! The command line: one file per subcommand. Data goes to stdout, talk to stderr.
//!
//! Uses everything. Start at [`main`].

mod camera;
mod cameras;
mod cell;
mod check;
mod events;
mod exit;
mod handheld;
mod import;
mod plan;
mod progress;
mod rehearsal;
mod replay;
mod report;
mod resume;
mod robot;
mod run;
mod schema;
mod session;
mod sim;
mod study;
mod target;
mod teach;

use clap::{Parser, Subcommand};

pub use exit::Exit;

/// Keeps robot cells calibrated.
#[derive(Debug, Parser)]
#[command(name = "cellcal", version, about, after_help = exit::HELP)]
struct Arguments {
    /// Threads for vision and solving; results do not depend on it. Default: all cores.
    #[arg(long, global = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Runs a session: moves the arm, captures, solves, judges.
    Run(run::Run),
    /// Goes on with a session that ended early: pre-flight again, then the missing poses only.
    Resume(resume::Resume),
    /// Looks at a robot without touching it.
    #[command(subcommand)]
    Robot(robot::Robot),
    /// Looks for cameras.
    #[command(subcommand)]
    Camera(camera::Camera),
    /// Writes a trajectory from poses to which the arm is guided by hand.
    Teach(teach::Teach),
    /// Simulates devices on their real protocols.
    #[command(subcommand)]
    Sim(sim::Sim),
    /// Repeats a recorded session without devices, with identical results.
    Replay(replay::Replay),
    /// Turns a foreign data set into a session.
    Import(import::Import),
    /// Checks a cell, its trajectories, reach, limits and duration; needs no hardware.
    Check(check::Check),
    /// Proposes one trajectory for cameras, stereo, hand-eye and checks; needs no hardware.
    Plan(plan::PlanPoses),
    /// Makes the images that the display shows.
    #[command(subcommand)]
    Target(target::Target),
    /// Shows a session or a result as a report.
    Report(report::Report),
    /// Experiments on the simulator, against its truth.
    #[command(subcommand)]
    Study(study::Study),
    /// Looks into event files.
    #[command(subcommand)]
    Events(events::Events),
    /// Prints the JSON Schema of a file.
    Schema(schema::Schema),
}

/// Runs the program; the exit code is that of the table in the README.
pub fn main() -> std::process::ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            let failed = error.use_stderr();
            // Help and version go to stdout, mistakes to stderr; nothing can be done where neither can be written.
            let _ = error.print();
            return if failed { Exit::Usage.into() } else { Exit::Ok.into() };
        }
    };
    match execute(arguments) {
        Ok(exit) => exit.into(),
        Err(error) => {
            progress::say(&format!("error: {error:#}"));
            exit::of_error(&error).into()
        }
    }
}

fn execute(arguments: Arguments) -> anyhow::Result<Exit> {
    let threads = arguments.threads.map_or(0, usize::from);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    // Images are spread over cores by us; threads inside OpenCV would only get in their way.
    crate::cv::set_threads(1)?;
    match arguments.command {
        Command::Run(command) => command.execute(),
        Command::Resume(command) => command.execute(),
        Command::Robot(command) => command.execute(),
        Command::Camera(command) => command.execute(),
        Command::Teach(command) => command.execute(),
        Command::Sim(command) => command.execute(),
        Command::Replay(command) => command.execute(),
        Command::Import(command) => command.execute(),
        Command::Check(command) => command.execute(),
        Command::Plan(command) => command.execute(),
        Command::Target(command) => command.execute(),
        Command::Report(command) => command.execute(),
        Command::Study(command) => command.execute(),
        Command::Events(command) => command.execute(),
        Command::Schema(command) => command.execute(),
    }
}

/// Writes data to stdout; a reader that has gone away is no error, a full disk is.
fn print(text: &str) -> anyhow::Result<()> {
    use std::io::Write as _;
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(anyhow::anyhow!("stdout: {error}")),
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Reads a text file; the error names it.
fn read_text(path: &std::path::Path) -> anyhow::Result<String> {
    let wrong = |why| exit::UsageError(format!("{}: {why}", path.display()));
    Ok(std::fs::read_to_string(path).map_err(wrong)?)
}
