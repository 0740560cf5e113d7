//! The program: parses, calls, prints, chooses the exit code.

fn main() -> std::process::ExitCode {
    cellcal::cli::main()
}
