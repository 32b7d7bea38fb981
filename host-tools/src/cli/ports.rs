//! `esm ports`: the serial ports that are plugged in, and the robots behind them.

use std::fmt;
use std::io::Write;

use clap::Args;
use esm_link::message::Mode;
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::status::mode_words;
use crate::ports::{self, Asked, Behind, Question, UsbDevice};
use crate::run::interrupt::Interrupt;
use crate::run::mission::hash_text;
use crate::serial;

/// Lists the serial ports that are plugged in, and the robots behind them
///
/// Asks each port for about a second, all at once, who is there. A port that another program has is
/// left alone. `ESM_PORTS` names ports that the system does not list, such as those of `esm board`:
/// paths with a colon between them.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm ports
  esm ports --json | jq '.ports[] | select(.robot)'
  ESM_PORTS=/dev/pts/7 esm ports          # with a robot that `esm board` simulates")]
pub struct PortsArgs {
    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,

    /// Bits per second on the robots' lines
    #[arg(long, value_name = "RATE", default_value_t = serial::DEFAULT_BAUD, value_parser = clap::value_parser!(u32).range(300..))]
    pub baud: u32,
}

/// The ports, in the form of their JSON.
#[derive(Debug, Serialize)]
struct PortsReport {
    ports: Vec<PortReport>,
}

/// A port. What is not known of it is `null`.
#[derive(Debug, Serialize)]
struct PortReport {
    /// As `--port` takes it.
    port: String,
    /// `robot`, `other version`, `in use`, `console`, `unopened` or `no robot`.
    state: &'static str,
    /// What it is, in words.
    told: String,
    usb: Option<UsbDevice>,
    robot: Option<RobotReport>,
}

/// A robot behind a port.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub struct RobotReport {
    /// Name of the board.
    pub board: String,
    /// Name and version of the firmware.
    pub firmware: String,
    /// Hash of the mission, if it has one.
    pub mission: Option<String>,
    /// Name of the mission's machine, where it was asked for and came in time.
    pub machine: Option<String>,
    /// As in `esm status`.
    pub mode: Option<&'static str>,
}

impl RobotReport {
    /// Of a port that was asked, where a robot is behind it.
    pub fn of(behind: &Behind) -> Option<Self> {
        let Behind::Robot {
            info,
            mode,
            machine,
        } = behind
        else {
            return None;
        };
        Some(RobotReport {
            board: info.board.clone(),
            firmware: info.firmware.clone(),
            mission: info.mission.map(hash_text),
            machine: machine.clone(),
            mode: mode.map(|mode| mode_words(mode).0),
        })
    }
}

impl From<&Asked> for PortReport {
    fn from(asked: &Asked) -> Self {
        PortReport {
            port: asked.listed.port().to_string(),
            state: match asked.behind {
                Behind::Robot { .. } => "robot",
                Behind::OtherVersion(_) => "other version",
                Behind::InUse { .. } => "in use",
                Behind::Console => "console",
                Behind::Unopened(_) => "unopened",
                Behind::NoRobot { .. } => "no robot",
            },
            told: asked.behind.to_string(),
            usb: asked.listed.usb.clone(),
            robot: RobotReport::of(&asked.behind),
        }
    }
}

/// A port as people read it: what is behind it, then what is known of the plug.
struct Shown<'a>(&'a Asked);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Shown(Asked { listed, behind }) = self;
        writeln!(f, "{}", listed.port())?;
        writeln!(f, "  {behind}")?;
        if let Some(robot) = RobotReport::of(behind) {
            match (&robot.mission, &robot.machine) {
                (Some(mission), Some(machine)) => write!(f, "  mission {machine}, {mission}")?,
                (Some(mission), None) => write!(f, "  mission {mission}")?,
                (None, _) => write!(f, "  no mission")?,
            }
            match robot.mode {
                Some(mode) if mode != mode_words(Mode::Empty).0 => writeln!(f, ", {mode}")?,
                _ => writeln!(f)?,
            }
        }
        let Some(usb) = &listed.usb else {
            return Ok(());
        };
        write!(f, "  USB {:04x}:{:04x}", usb.vendor_id, usb.product_id)?;
        if let Some(product) = &usb.product {
            write!(f, ", {product}")?;
        }
        if let Some(maker) = &usb.maker {
            write!(f, ", made by {maker}")?;
        }
        if let Some(number) = &usb.serial_number {
            write!(f, ", serial number {number}")?;
        }
        writeln!(f)
    }
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &PortsArgs, console: &mut Console) -> Result<(), CommandError> {
    Interrupt::take_over()?;
    let listed = ports::listed().map_err(ports::FindError::List)?;
    let asked = ports::ask_all(listed, args.baud, Question::WhoAndWhat)?;
    if args.json {
        let ports = asked.iter().map(PortReport::from).collect();
        return console.json_line(&PortsReport { ports });
    }
    if asked.is_empty() {
        console.note(
            "no serial port is plugged in; `ESM_PORTS` names those that the system does not list, such as that of `esm board`",
        );
    }
    for port in &asked {
        write!(console.out(), "{}", Shown(port))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ports::Listed;

    #[test]
    fn what_is_known_of_a_plug_is_shown() {
        let asked = Asked {
            listed: Listed {
                path: "/dev/ttyACM0".into(),
                usb: Some(UsbDevice {
                    vendor_id: 0x2e8a,
                    product_id: 0xa,
                    serial_number: Some("E660".into()),
                    maker: Some("Raspberry Pi".into()),
                    product: None,
                }),
                is_console: false,
            },
            behind: Behind::InUse { by_esm: true },
        };
        assert_eq!(
            Shown(&asked).to_string(),
            "/dev/ttyACM0\n  in use by another esm command\n  USB 2e8a:000a, made by Raspberry Pi, serial number E660\n"
        );
        let json = serde_json::to_value(PortReport::from(&asked)).unwrap();
        assert_eq!(json["usb"]["vendor_id"], 0x2e8a);
        assert_eq!(json["state"], "in use");
        assert!(json["robot"].is_null() && json["usb"]["product"].is_null());
    }
}
