//! Uploads that end before they are done: the robot drives on, and the next upload works.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::io;
use std::path::Path;
use std::time::Duration;

use esm_tests::command::root;
use esm_tests::environment;
use esm_tests::random::Random;
use esm_tests::subject;
use host_tools::host_board::{self, HostBoard};
use host_tools::link_client::LinkClient;
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::serial::port::Port;
use host_tools::serial::pty::PtyServer;
use host_tools::serial::{self, ByteLink};
use host_tools::world::World;
use rt_firmware::link::message::Mode;

/// Faster than a real line, for the sake of the test's time.
const BAUD: u32 = 921_600;

/// What becomes of a client after so many bytes that it has sent.
#[derive(Clone, Copy, Debug)]
enum Fate {
    /// The line breaks off in the middle of a frame; the client goes, and the pseudo-terminal is closed.
    Cut,
    /// It sleeps, and goes on.
    Pause(Duration),
    /// What it sends from here on arrives nowhere, for so many bytes.
    Hole(usize),
}

/// A line to a client with a fate.
struct Fateful<L> {
    line: L,
    left: usize,
    fate: Option<Fate>,
    hole: usize,
}

impl<L: ByteLink> ByteLink for Fateful<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line.receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        for byte in bytes {
            if self.left == 0 {
                match self.fate.take() {
                    Some(Fate::Cut) => return Err(io::ErrorKind::BrokenPipe.into()),
                    Some(Fate::Pause(duration)) => std::thread::sleep(duration),
                    Some(Fate::Hole(bytes)) => self.hole = bytes,
                    None => {}
                }
            }
            self.left = self.left.saturating_sub(1);
            match self.hole.checked_sub(1) {
                Some(hole) => self.hole = hole,
                None => self.line.send(&[*byte])?,
            }
        }
        Ok(())
    }
}

fn blob(path: &str) -> Vec<u8> {
    subject::build_file(&root().join(path)).unwrap().blob
}

/// Opens the robot's port and begins a session.
fn connect(port: &Path) -> LinkClient<Box<dyn ByteLink>> {
    let line = serial::open(&Port::Tty(port.to_owned()), BAUD).unwrap();
    LinkClient::connect(line).unwrap().0
}

#[test]
fn the_robot_drives_on_and_the_next_upload_works_wherever_one_ends() {
    let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(false), None);
    let (board, line) = HostBoard::start(host_board::rover, plant, None).unwrap();
    let server = PtyServer::start(Box::new(line)).unwrap();
    let missions = ["missions/patrol.esm", "missions/follow_wall.esm"].map(blob);
    connect(server.path())
        .upload(&missions[0], &mut |_| ())
        .unwrap();

    let rounds = environment::number("ESM_INTERRUPTIONS", 50) as usize;
    let mut random = Random::new(environment::number("ESM_SEED", 0));
    let mut resumed = 0;
    for round in 0..rounds {
        let next = &missions[(round + 1) % missions.len()];
        let before = connect(server.path()).status().unwrap();
        let fate = match random.between(0, 3) {
            0 => Fate::Pause(Duration::from_millis(random.between(1, 400) as u64)),
            1 => Fate::Hole(random.between(1, 400)),
            _ => Fate::Cut,
        };
        // Up to beyond the last chunk, so that some break off at the commit.
        let left = random.between(0, next.len() * 11 / 10);
        let what = format!("round {round}, {fate:?} after {left} bytes");
        let line = serial::open(&Port::Tty(server.path().to_owned()), BAUD).unwrap();
        let fateful = Fateful {
            line,
            left,
            fate: Some(fate),
            hole: 0,
        };
        let mut told = Vec::new();
        let ended = LinkClient::connect(fateful)
            .and_then(|(mut client, _)| client.upload(next, &mut |bytes| told.push(bytes)));
        if !matches!(fate, Fate::Cut) {
            assert!(ended.is_ok(), "{what}: {ended:?}");
        }

        let mut client = connect(server.path());
        let status = client.status().unwrap();
        assert_eq!(status.mode, Mode::Running, "{what}");
        assert_eq!((status.missed, status.overruns), (0, 0), "{what}");
        if status.mission == before.mission {
            assert!(status.steps > before.steps, "{what}: it stands still");
        }
        let mut first = None;
        let hash = client
            .upload(next, &mut |bytes| {
                first.get_or_insert(bytes);
            })
            .unwrap();
        let there = told.last().copied().unwrap_or(0);
        if ended.is_err() && there < next.len() && status.mission == before.mission {
            assert!(
                first.unwrap_or(0) >= there,
                "{what}: {there} bytes were there"
            );
            resumed += usize::from(first.unwrap_or(0) > 0);
        }
        assert_eq!(client.status().unwrap().mission, Some(hash), "{what}");
        assert_eq!(client.running_blob().unwrap(), *next, "{what}");
        board.check().unwrap();
    }
    assert!(resumed > rounds / 10, "only {resumed} went on");
}
