//! `esm stop` takes a port over from the process that has it.
//!
//! Whoever opens a port serves a control socket for it, in a directory of its user alone and under
//! a name that follows from the port. Who wants to stop the robot connects there and is handed the
//! open file of the line; from that moment on the process that had it neither reads nor writes it.
//! A thread of its own serves the socket, so that the line is handed over within milliseconds also
//! where everything else in the process is busy.
//!
//! A process that is suspended hands over nothing. So ports are never opened for one process alone:
//! a lock (`flock`) says that one is in use, which commands heed and a stop does not.

use std::ffi::OsString;
use std::fs::{self, DirBuilder};
use std::io::{self, IoSlice, IoSliceMut, Read, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::{Errno, FdFlags};
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketType,
};
use thiserror::Error;

use super::port::Port;
use super::wire::{Wire, wait_for};

/// How long whoever wants to stop a robot waits for the process that has the line. A tenth of a
/// second is all that a stop may take.
const ANSWER_WAIT: Duration = Duration::from_millis(50);

/// How long a client may take to say what it wants; it says so when it connects.
const REQUEST_WAIT: Duration = Duration::from_millis(20);

/// Begins what a client says; the rest of its line is the port's identity.
const REQUEST: &str = "esm take over 1 ";

/// Bytes of a request at most: the longest name of a host (253) and room to spare.
const MAX_REQUEST_BYTES: usize = 512;

/// The answer that the file of the line comes with.
const GRANTED: u8 = b'1';

/// What the directories of control sockets are called.
const FOLDER: &str = "esm";

/// Ending of a control socket's name.
const ENDING: &str = "port";

/// Its user alone may look into such a directory, and put something there.
const FOLDER_MODE: u32 = 0o700;

/// Why `esm stop` cannot take a port over from this process.
#[derive(Debug, Error)]
pub enum NotServed {
    /// No directory that nobody else can write to.
    #[error(
        "there is no safe directory for the control socket: {} \
         belongs to somebody else or is open to others; remove it, or set XDG_RUNTIME_DIR",
        path.display()
    )]
    NoFolder {
        /// The last that was tried.
        path: PathBuf,
    },
    /// The system forbids something.
    #[error("the control socket cannot be made: {0}")]
    System(#[from] io::Error),
}

/// What a port is, however it is named: its device, its socket, its address.
pub(super) fn identity(port: &Port) -> io::Result<String> {
    Ok(match port {
        Port::Tty(path) => {
            let found = fs::metadata(path)?;
            if !found.file_type().is_char_device() {
                return Err(io::ErrorKind::InvalidInput.into());
            }
            format!("device {} {}", found.dev(), found.rdev())
        }
        Port::Unix(path) => {
            let found = fs::metadata(path)?;
            format!("socket {} {}", found.dev(), found.ino())
        }
        Port::Tcp { host, port } => format!("tcp {} {port}", host.to_lowercase()),
        // No other process can name it.
        Port::Own(_) => return Err(io::ErrorKind::Unsupported.into()),
    })
}

/// Directories that control sockets may be in, best first. Where the environment of two processes
/// differs, the second finds what the first took.
fn folders() -> Vec<PathBuf> {
    let user = rustix::process::geteuid().as_raw();
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").filter(|folder: &OsString| {
        // As its specification has it.
        Path::new(folder).is_absolute()
    });
    let mut folders: Vec<PathBuf> = Vec::new();
    let in_runtime = [
        runtime.map(PathBuf::from),
        Some(format!("/run/user/{user}").into()),
    ];
    folders.extend(in_runtime.into_iter().flatten().map(|it| it.join(FOLDER)));
    for temporary in [std::env::temp_dir(), "/tmp".into()] {
        folders.push(temporary.join(format!("{FOLDER}-{user}")));
    }
    let mut seen = Vec::new();
    folders.retain(|folder| {
        let is_new = !seen.contains(folder);
        seen.push(folder.clone());
        is_new
    });
    folders
}

/// Whether what is there is a directory that only this user can use.
fn is_ours(folder: &Path) -> bool {
    // A link may point to what somebody else exchanges.
    fs::symlink_metadata(folder)
        .is_ok_and(|found| found.is_dir() && is_private(found.uid(), found.permissions().mode()))
}

/// Whether such an owner and mode leave nobody else anything.
fn is_private(owner: u32, mode: u32) -> bool {
    owner == rustix::process::geteuid().as_raw() && mode & 0o077 == 0
}

/// A directory for control sockets, made if need be.
fn folder() -> Result<PathBuf, NotServed> {
    let mut last = PathBuf::new();
    for folder in folders() {
        // Where it is there already, or cannot be made, the look behind this says so.
        let _ = DirBuilder::new().mode(FOLDER_MODE).create(&folder);
        if is_ours(&folder) {
            return Ok(folder);
        }
        if folder.exists() || last.as_os_str().is_empty() {
            last = folder;
        }
    }
    Err(NotServed::NoFolder { path: last })
}

/// Where the control socket of a port is in a directory: FNV-1a, 64 bits, of its identity, since a
/// socket's path is short.
fn socket_in(folder: &Path, identity: &str) -> PathBuf {
    let hash = identity
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
    folder.join(format!("{hash:016x}.{ENDING}"))
}

/// Connects without waiting: a process that is suspended accepts nobody.
fn connect(path: &Path) -> io::Result<UnixStream> {
    let socket = rustix::net::socket(AddressFamily::UNIX, SocketType::STREAM, None)?;
    rustix::io::fcntl_setfd(&socket, FdFlags::CLOEXEC)?;
    rustix::io::ioctl_fionbio(&socket, true)?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket.into())
}

/// Serves the control socket of a line for as long as this lives.
pub(super) struct Holder {
    /// Closed at the end, which ends the thread.
    wake: Option<UnixStream>,
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
    /// Device and number of the socket's file: another process may have put its own in that place.
    file: (u64, u64),
}

impl Holder {
    /// Begins to serve. `None` where another process serves this port, which is a socket with
    /// several clients.
    ///
    /// # Errors
    /// [`NotServed`]
    pub(super) fn begin(identity: &str, wire: Arc<Wire>) -> Result<Option<Self>, NotServed> {
        let folder = folder()?;
        clear(&folder);
        let path = socket_in(&folder, identity);
        let listener = match UnixListener::bind(&path) {
            Ok(listener) => listener,
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let found = fs::symlink_metadata(&path)?;
        listener.set_nonblocking(true)?;
        let (wake, woken) = UnixStream::pair()?;
        let identity = identity.to_owned();
        let thread = std::thread::Builder::new()
            .name("port control".into())
            .spawn(move || serve(&listener, &woken, &identity, &wire))?;
        Ok(Some(Holder {
            wake: Some(wake),
            thread: Some(thread),
            path,
            file: (found.dev(), found.ino()),
        }))
    }
}

impl Drop for Holder {
    fn drop(&mut self) {
        let is_own = fs::symlink_metadata(&self.path)
            .is_ok_and(|found| (found.dev(), found.ino()) == self.file);
        if is_own {
            // A socket that stays is found to be stale by the next.
            let _ = fs::remove_file(&self.path);
        }
        self.wake = None;
        if let Some(thread) = self.thread.take() {
            // It has a share in the line's file. Had it failed, there would be nobody to tell.
            let _ = thread.join();
        }
    }
}

/// Removes what processes left behind that have ended without being able to.
fn clear(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for path in entries.flatten().map(|entry| entry.path()) {
        let is_control = path.extension().is_some_and(|ending| ending == ENDING);
        // One that takes no more connections for now is alive.
        let is_refused = |error: io::Error| error.kind() == io::ErrorKind::ConnectionRefused;
        if is_control && connect(&path).is_err_and(is_refused) {
            let _ = fs::remove_file(&path);
        }
    }
}

/// Hands the line to whoever asks, until the other end of `woken` closes.
fn serve(listener: &UnixListener, woken: &UnixStream, identity: &str, wire: &Wire) {
    loop {
        let mut files = [
            PollFd::new(listener, PollFlags::IN),
            PollFd::new(woken, PollFlags::IN),
        ];
        match poll(&mut files, None) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(_) => return,
        }
        if !files[1].revents().is_empty() {
            return;
        }
        if let Ok((client, _)) = listener.accept() {
            // A client that has gone, or says nothing of use, gets nothing.
            let _ = answer(client, identity, wire);
        }
    }
}

/// Hands the line to a client, if it asks for this one.
fn answer(mut client: UnixStream, identity: &str, wire: &Wire) -> io::Result<()> {
    client.set_nonblocking(false)?;
    client.set_read_timeout(Some(REQUEST_WAIT))?;
    let mut request = [0; MAX_REQUEST_BYTES];
    let count = client.read(&mut request)?;
    if request.get(..count) != Some(request_for(identity).as_bytes()) {
        return Ok(());
    }
    wire.hand_over(|file| {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        let files = [file.as_fd()];
        if !control.push(SendAncillaryMessage::ScmRights(&files)) {
            return Err(io::ErrorKind::OutOfMemory.into());
        }
        let granted = [IoSlice::new(&[GRANTED])];
        rustix::net::sendmsg(&client, &granted, &mut control, SendFlags::DONTWAIT)?;
        Ok(())
    })
}

fn request_for(identity: &str) -> String {
    format!("{REQUEST}{identity}\n")
}

/// The file of a port's line, from the process that has it. `None` where nobody serves it, or who
/// does gives no answer in time.
pub(super) fn take(identity: &str) -> Option<OwnedFd> {
    let deadline = Instant::now() + ANSWER_WAIT;
    let sockets = folders().into_iter().filter(|folder| is_ours(folder));
    for socket in sockets.map(|folder| socket_in(&folder, identity)) {
        let Ok(mut control) = connect(&socket) else {
            continue;
        };
        if control.write_all(request_for(identity).as_bytes()).is_err() {
            continue;
        }
        if let Some(file) = granted(&control, deadline) {
            return Some(file);
        }
    }
    None
}

/// Whether a process of this user serves a port. It is asked for nothing.
pub(super) fn is_served(identity: &str) -> bool {
    let mut sockets = folders().into_iter().filter(|folder| is_ours(folder));
    sockets.any(|folder| connect(&socket_in(&folder, identity)).is_ok())
}

/// What a process answers.
fn granted(control: &UnixStream, deadline: Instant) -> Option<OwnedFd> {
    loop {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut ancillary = RecvAncillaryBuffer::new(&mut space);
        let mut byte = [0];
        let mut into = [IoSliceMut::new(&mut byte)];
        match rustix::net::recvmsg(control, &mut into, &mut ancillary, RecvFlags::empty()) {
            Ok(_) => {
                let file = ancillary.drain().find_map(|message| match message {
                    RecvAncillaryMessage::ScmRights(mut files) => files.next(),
                    _ => None,
                })?;
                rustix::io::fcntl_setfd(&file, FdFlags::CLOEXEC).ok()?;
                return (byte == [GRANTED]).then_some(file);
            }
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(_) => return None,
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return None;
        }
        wait_for(control, PollFlags::IN, left).ok()?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directory_is_trusted_only_where_nobody_else_can_use_it() {
        let user = rustix::process::geteuid().as_raw();
        for (owner, mode, is_trusted) in [
            (user, 0o040_700, true),
            (user, 0o040_600, true),
            (user, 0o040_750, false),
            (user, 0o040_701, false),
            (user, 0o041_777, false),
            (user + 1, 0o040_700, false),
        ] {
            assert_eq!(is_private(owner, mode), is_trusted, "{owner} {mode:o}");
        }
        let folder = tempfile::tempdir().unwrap();
        let [real, link, file] = ["real", "link", "file"].map(|name| folder.path().join(name));
        DirBuilder::new().mode(FOLDER_MODE).create(&real).unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        fs::write(&file, "").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
        assert!(is_ours(&real));
        assert!(!is_ours(&link) && !is_ours(&file));
    }

    #[test]
    fn sockets_of_processes_that_have_ended_are_removed_and_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        drop(UnixListener::bind(at("dead.port")).unwrap());
        let _alive = UnixListener::bind(at("alive.port")).unwrap();
        fs::write(at("other"), "").unwrap();
        clear(folder.path());
        let is_there = ["dead.port", "alive.port", "other"].map(|name| at(name).exists());
        assert_eq!(is_there, [false, true, true]);
    }

    #[test]
    fn a_port_is_the_same_by_each_of_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("robot");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        let of = |name: &str| identity(&name.parse().unwrap()).unwrap();
        assert_eq!(of("/dev/null"), of(link.to_str().unwrap()));
        assert_ne!(of("/dev/null"), of("/dev/zero"));
        assert_eq!(of("tcp:Robot:4000"), of("tcp:robot:4000"));
        assert_ne!(of("tcp:robot:4000"), of("tcp:robot:4001"));
    }
}
