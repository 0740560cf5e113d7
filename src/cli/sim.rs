//! `cellcal sim`: simulated devices on their real protocols.

use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};

use super::progress::say;
use super::{Exit, cell};
use crate::config;
use crate::devices::sim::cell::controller_config;
use crate::devices::sim::ur::{Flaws, Planned as PlannedFault, Ports, SimController, SimUrConfig};

/// Simulates devices.
#[derive(Debug, Subcommand)]
pub(super) enum Sim {
    /// A UR5e controller: RTDE 30004, dashboard 29999, scripts 30001 to 30003.
    Ur(SimUr),
}

impl Sim {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        match self {
            Self::Ur(ur) => ur.execute(),
        }
    }
}

/// A UR5e controller on its real ports, in real time, until Ctrl-C.
#[derive(Debug, Args)]
pub(super) struct SimUr {
    /// Address to listen on.
    #[arg(long, default_value = "127.0.0.1")]
    host: IpAddr,
    /// Takes TCP, payload, home and serial from this cell file.
    #[arg(long)]
    cell: Option<PathBuf>,
    /// Lets the system choose free ports and prints them.
    #[arg(long)]
    free_ports: bool,
    /// Draws the individual arm and its noise.
    #[arg(long, default_value = "1")]
    seed: u64,
    /// Makes it fail, such as `protective_stop@move:3` or `stall@t:5`; may be repeated.
    #[arg(long = "fault", value_name = "FAULT@WHEN")]
    faults: Vec<PlannedFault>,
}

impl SimUr {
    fn execute(self) -> anyhow::Result<Exit> {
        let base = match &self.cell {
            None => SimUrConfig::default(),
            Some(path) => {
                let texts = cell::load(path)?;
                controller_config(&config::parse_cell(&texts.cell.1, &texts.cell.0)?, Flaws::default(), 1.0)
            }
        };
        let config = SimUrConfig {
            address: self.host,
            ports: if self.free_ports { Ports::default() } else { Ports::REAL },
            time_scale: 1.0,
            // Real time: nobody is waited for.
            lock_step_patience: Duration::ZERO,
            faults: self.faults,
            ..base
        };
        let controller = SimController::start(config, self.seed)?;
        let Ports { rtde, primary, secondary, realtime, dashboard } = controller.ports();
        let host = controller.address();
        say(&format!(
            "simulated UR5e at {host}: RTDE {rtde}, dashboard {dashboard}, scripts {primary}, {secondary}, {realtime}; Ctrl-C ends it"
        ));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(async {
            let mut terminate = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())?;
            tokio::select! {
                ended = tokio::signal::ctrl_c() => ended,
                _ = terminate.recv() => Ok(()),
            }
        })?;
        Ok(Exit::Ok)
    }
}
