//! A board in the emulator with a firmware that measures itself, driven over its serial line.

use std::fs;
use std::io;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use host_tools::link_client::LinkClient;

/// Nanoseconds that an instruction takes, as a power of two: 12.8 ticks of the default board's
/// timer.
const SHIFT: u32 = 8;
/// The socket that is the board's UART0, in the emulator's folder.
const UART_SOCKET: &str = "uart0";
/// What the firmware prints, in the emulator's folder.
const CONSOLE: &str = "console";

/// QEMU with a firmware, without anything to see: `machine` is its name for the board, an
/// instruction takes two to the power of `shift` nanoseconds, and the firmware's files are in
/// `folder`.
pub fn emulator(machine: &str, shift: u32, firmware: &Path, folder: &Path) -> Command {
    let mut command = Command::new(host_tools::qemu::QEMU);
    command
        .args(["-machine", machine, "-icount"])
        .arg(format!("shift={shift},sleep=off"))
        .args(["-nographic", "-monitor", "none"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(firmware)
        .current_dir(folder);
    command
}

/// A board that runs as long as this value is there.
pub struct Emulated {
    emulator: Child,
    console: PathBuf,
}

impl Drop for Emulated {
    fn drop(&mut self) {
        let _ = self.emulator.kill();
        let _ = self.emulator.wait();
    }
}

impl Emulated {
    /// Starts a firmware of the default board in `folder`, and connects to it.
    ///
    /// # Errors
    /// What the system says, or that the firmware does not answer.
    pub fn start(firmware: &Path, folder: &Path) -> Result<(Self, LinkClient<UnixStream>), String> {
        Self::start_with(firmware, folder, &[])
    }

    /// The same with more arguments for the emulator.
    ///
    /// # Errors
    /// As of [`start`](Self::start).
    pub fn start_with(
        firmware: &Path,
        folder: &Path,
        more: &[&str],
    ) -> Result<(Self, LinkClient<UnixStream>), String> {
        Self::start_on(host_tools::qemu::machine(), firmware, folder, more)
    }

    /// The same on the machine that QEMU calls so.
    ///
    /// # Errors
    /// As of [`start`](Self::start).
    pub fn start_on(
        machine: &str,
        firmware: &Path,
        folder: &Path,
        more: &[&str],
    ) -> Result<(Self, LinkClient<UnixStream>), String> {
        let told = |error: io::Error| format!("{}: {error}", firmware.display());
        let program = firmware.canonicalize().map_err(told)?;
        let listener = UnixListener::bind(folder.join(UART_SOCKET)).map_err(told)?;
        let console = folder.join(CONSOLE);
        let printed = fs::File::create(&console).map_err(told)?;
        let emulator = emulator(machine, SHIFT, &program, folder)
            .arg("-chardev")
            .arg(format!("socket,id=uart0,path={UART_SOCKET},server=off"))
            .args(["-serial", "chardev:uart0"])
            .args(more)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            // Where the emulator puts what the firmware prints.
            .stderr(printed)
            .spawn()
            .map_err(|error| format!("{}: {error}", host_tools::qemu::QEMU))?;
        let emulated = Self { emulator, console };
        let (uart, _) = listener.accept().map_err(told)?;
        let (client, _) = LinkClient::connect(uart).map_err(|error| error.to_string())?;
        Ok((emulated, client))
    }

    /// Whether it still runs.
    ///
    /// # Errors
    /// What the system says.
    pub fn runs(&mut self) -> io::Result<bool> {
        Ok(self.emulator.try_wait()?.is_none())
    }

    /// What the firmware has printed until now.
    ///
    /// # Errors
    /// What the system says.
    pub fn printed(&self) -> io::Result<String> {
        fs::read_to_string(&self.console)
    }
}
