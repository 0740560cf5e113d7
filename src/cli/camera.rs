//! `cellcal camera`: looks for cameras.

use clap::{Args, Subcommand};

use super::Exit;

/// Looks for cameras.
#[derive(Debug, Subcommand)]
pub(super) enum Camera {
    /// Lists the GenICam cameras that answer; asks by broadcast on every network.
    List(List),
}

/// Lists the GenICam cameras that answer; asks by broadcast on every network.
#[derive(Debug, Args)]
pub(super) struct List {
    /// Prints JSON.
    #[arg(long)]
    json: bool,
}

impl Camera {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        match self {
            Self::List(command) => command.execute(),
        }
    }
}

#[cfg(not(feature = "genicam"))]
impl List {
    fn execute(self) -> anyhow::Result<Exit> {
        let Self { json: _ } = self;
        Err(super::exit::UsageError(super::cameras::NO_GENICAM.into()).into())
    }
}

#[cfg(feature = "genicam")]
impl List {
    fn execute(self) -> anyhow::Result<Exit> {
        use crate::devices::genicam::{Found, list};
        let all = list();
        let entry = |f: &Found| {
            let Found { id: _, vendor, model, serial, protocol, address } = f;
            serde_json::json!({"vendor": vendor, "model": model, "serial": serial, "protocol": protocol, "address": address})
        };
        if self.json {
            let cameras: Vec<_> = all.iter().map(entry).collect();
            let text = serde_json::to_string_pretty(&serde_json::json!({"schema_version": 1, "cameras": cameras}))?;
            super::print(&format!("{text}\n"))?;
            return Ok(Exit::Ok);
        }
        if all.is_empty() {
            super::progress::say(
                "no GenICam camera answers; is it powered, in the same subnet, and no firewall between?",
            );
        }
        for Found { vendor, model, serial, protocol, address, .. } in &all {
            super::print(&format!("{serial}  {vendor} {model}  {protocol}  {address}\n"))?;
        }
        Ok(Exit::Ok)
    }
}
