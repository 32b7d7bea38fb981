//! `esm key`: who may command a robot.

use std::fmt;
use std::io::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::{Args, Subcommand};
use esm_link::access::Access;
use esm_link::features::Feature;
use serde::Serialize;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;
use super::robot::{self, KEY_VARIABLE, LineArgs, RobotArgs};
use crate::keys::{self, KeyError, PublicKey, SigningKey};
use crate::link_client::ClientError;

/// Makes and installs the key without which a robot takes no commands
///
/// A robot takes missions and commands from anyone who reaches its line, until it has a key. From
/// then on it takes them only if the key has signed them. Reading stays open to everyone, and so
/// does `esm stop`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm key new
  esm key install --port /dev/ttyUSB0
  esm upload missions/patrol.esm --port /dev/ttyUSB0                  # signed with the same key
  esm key show --port /dev/ttyUSB0
  esm key new -o robot7.key
  esm key install --port /dev/ttyUSB0 --key robot7.key --present ~/.config/esm/key
  esm key remove --port /dev/ttyUSB0 --key robot7.key")]
pub struct KeyArgs {
    /// What to do.
    #[command(subcommand)]
    pub action: Action,
}

/// What is done with keys.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Makes a key and keeps it in a file that nobody else may read
    New(NewArgs),
    /// Shows the public part of a key, or of a robot's
    Show(ShowArgs),
    /// Gives a robot a key; one that has another takes it from that one's owner alone
    Install(InstallArgs),
    /// Lets a robot forget its key, so that it takes commands from anyone
    Remove(RemoveArgs),
}

/// Arguments of `esm key new`.
#[derive(Debug, Args)]
pub struct NewArgs {
    /// The file to make [default: esm/key in the folder for configuration, ~/.config]
    #[arg(short, long, value_name = "FILE", env = KEY_VARIABLE)]
    pub output: Option<PathBuf>,
}

/// Arguments of `esm key show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// The key's file [default: esm/key in the folder for configuration, ~/.config]
    #[arg(long, value_name = "FILE", env = KEY_VARIABLE)]
    pub key: Option<PathBuf>,

    /// The robot whose key to show: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT")]
    pub port: Option<Port>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub line: LineArgs,
}

/// Arguments of `esm key install`.
#[derive(Debug, Args)]
#[command(mut_arg("key", |key| key.help("The key to give to the robot [default: esm/key in the folder for configuration, ~/.config]")))]
pub struct InstallArgs {
    /// The key that the robot has now, if it has one
    #[arg(long, value_name = "FILE")]
    pub present: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// Arguments of `esm key remove`.
#[derive(Debug, Args)]
pub struct RemoveArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// What is shown of a key, in the form of its JSON.
#[derive(Serialize)]
struct Shown {
    /// The public part, in hex; none where the robot has no key, or one that cannot be read.
    key: Option<String>,
    /// Whether commands are taken from the owner of a key alone.
    locked: bool,
    /// Counter of the last upload that the robot accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    uploads: Option<u64>,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &KeyArgs, console: &mut Console) -> Result<(), CommandError> {
    match &args.action {
        Action::New(args) => make(args, console),
        Action::Show(args) => show(args, console),
        Action::Install(args) => install(args, console),
        Action::Remove(args) => remove(args, console),
    }
}

fn make(args: &NewArgs, console: &mut Console) -> Result<(), CommandError> {
    let path = keys::path(args.output.as_deref())?;
    let key = SigningKey::create(&path)?;
    writeln!(
        console.out(),
        "made the key {}\nits private part is in {}, which is yours alone: whoever has it commands the robots that have this key, and without it nobody does",
        key.public(),
        path.display()
    )?;
    Ok(())
}

fn show(args: &ShowArgs, console: &mut Console) -> Result<(), CommandError> {
    let shown = match &args.port {
        None => {
            let key = SigningKey::read(&keys::path(args.key.as_deref())?).map_err(how_to_make)?;
            Shown::of_key(&key.public())
        }
        Some(_) if robot::is_named(args.key.as_deref()) => {
            return Err(CommandError::Usage(anyhow!(
                "the key in a file is shown, or a robot's: leave out `--key` or `--port`"
            )));
        }
        Some(port) => {
            let (mut robot, info) = robot::connect(port, args.line, console)?;
            match info.access {
                Access::Locked | Access::Recovering => {
                    let identity = robot.identity()?;
                    Shown {
                        uploads: Some(identity.counter),
                        ..Shown::of_key(&identity.key)
                    }
                }
                Access::Unreadable | Access::Damaged => Shown::UNREADABLE,
                Access::Unsupported | Access::Open => Shown::NONE,
            }
        }
    };
    if args.json {
        return console.json_line(&shown);
    }
    writeln!(console.out(), "{shown}")?;
    Ok(())
}

impl Shown {
    /// Of a robot that takes commands from anyone.
    const NONE: Self = Shown {
        key: None,
        locked: false,
        uploads: None,
    };

    /// Of a robot that does not know its key any more.
    const UNREADABLE: Self = Shown {
        locked: true,
        ..Shown::NONE
    };

    fn of_key(key: &PublicKey) -> Self {
        Shown {
            key: Some(key.to_string()),
            locked: true,
            uploads: None,
        }
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.key, self.uploads) {
            (Some(key), Some(uploads)) => write!(
                f,
                "{key}\nthe last upload that the robot accepted was number {uploads}"
            ),
            (Some(key), None) => write!(f, "{key}"),
            (None, _) if self.locked => write!(
                f,
                "what the robot keeps of its key cannot be read, its memory is damaged: it is locked, and takes no commands but `esm stop`"
            ),
            (None, _) => write!(f, "the robot has no key"),
        }
    }
}

fn install(args: &InstallArgs, console: &mut Console) -> Result<(), CommandError> {
    let key = match SigningKey::read(&keys::path(args.robot.key.as_deref())?) {
        Err(missing @ KeyError::Missing { .. }) => Err(missing),
        read => Ok(read?),
    };
    let (mut robot, info) = args.robot.connect_quietly()?;
    let key = key.map_err(|missing| match info.access {
        // The owner's key is elsewhere, and a new one is none that the robot knows.
        Access::Locked | Access::Recovering => missing.into(),
        _ => how_to_make(missing),
    })?;
    match (info.access, &args.present) {
        (Access::Open | Access::Damaged, _) => {}
        (Access::Locked, Some(present)) => {
            let present = present.clone();
            robot.use_key(Box::new(move || SigningKey::read(&present)));
        }
        (Access::Locked, None) => {
            if robot.identity()?.key == key.public() {
                writeln!(
                    console.out(),
                    "the robot has the key {} already",
                    key.public()
                )?;
                return Ok(());
            }
            return Err(CommandError::Input(anyhow!(
                "the robot has another key already; `--present FILE` names it, and only its owner may replace it"
            )));
        }
        // Its records begin anew with a key that the owner from before the damage has signed.
        (Access::Recovering, present) => {
            let present = keys::path(present.as_deref().or(args.robot.key.as_deref()))?;
            robot.use_key(Box::new(move || SigningKey::read(&present)));
        }
        (Access::Unsupported, _) => {
            return Err(ClientError::NotBuiltIn {
                feature: Feature::Keys,
            }
            .into());
        }
        (Access::Unreadable, _) => {
            return Err(CommandError::World(anyhow!(
                "what the robot keeps of its key cannot be read: its memory is damaged"
            )));
        }
    }
    robot.install_key(&key)?;
    writeln!(
        console.out(),
        "installed: the robot takes missions and commands from the owner of the key {} alone; anyone may read, and stop it",
        key.public()
    )?;
    Ok(())
}

/// An error of a key that is to be shown, or given to a robot that has none, with what makes one.
fn how_to_make(error: KeyError) -> CommandError {
    match &error {
        KeyError::Missing { path } => {
            let path = path.display();
            CommandError::World(anyhow!("{error}; `esm key new -o {path}` makes it"))
        }
        _ => error.into(),
    }
}

fn remove(args: &RemoveArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, _) = args.robot.connect_quietly()?;
    robot.remove_key()?;
    writeln!(
        console.out(),
        "removed: the robot takes missions and commands from anyone"
    )?;
    Ok(())
}

/// A file that holds no key is bad input; all else is the outside world.
impl From<KeyError> for CommandError {
    fn from(error: KeyError) -> Self {
        match error {
            KeyError::NotAKey { .. } => CommandError::Input(error.into()),
            _ => CommandError::World(error.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_whose_key_cannot_be_read_is_locked_and_not_without_key() {
        assert_eq!(Shown::NONE.to_string(), "the robot has no key");
        let text = Shown::UNREADABLE.to_string();
        assert!(
            text.contains("cannot be read") && text.contains("`esm stop`"),
            "{text}"
        );
        let json = serde_json::to_value(Shown::UNREADABLE).unwrap();
        assert_eq!(json, serde_json::json!({"key": null, "locked": true}));
    }
}
