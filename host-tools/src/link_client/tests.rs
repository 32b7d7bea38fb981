//! The client against the firmware's own end of the link, over lines that are good, bad, and cut.

use super::*;
use crate::host_board::{self, HostBoard};
use crate::lockstep::pace::Pace;
use crate::lockstep::plant_side::PlantSide;
use crate::plant::{BodyParameters, Plant};
use crate::serial::noise::{Noise, Noisy};
use crate::serial::pipe::{self, PipeEnd};
use crate::world::World;
use esm_core::Refusal;
use std::io;

fn robot() -> (HostBoard, PipeEnd) {
    let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(false), None);
    HostBoard::start(host_board::rover, plant, None).unwrap()
}

fn declarations<L: ByteLink>(client: &mut LinkClient<L>, info: &RobotInfo) -> Vec<String> {
    (0..info.task_types)
        .map(|index| client.task_declaration(index).unwrap())
        .collect()
}

/// Bytes that are no blob, all different from their neighbours.
fn junk(length: usize) -> Vec<u8> {
    (0..length).map(|i| (i * 31 + i / 256) as u8).collect()
}

#[test]
fn a_robot_says_who_it_is_and_what_it_can() {
    let (_board, line) = robot();
    let (mut client, info) = LinkClient::connect(line).unwrap();
    assert_eq!(info.board, host_board::BOARD);
    assert_eq!(info.mission, None);
    let declarations = declarations(&mut client, &info);
    assert!(
        declarations
            .iter()
            .any(|text| text.starts_with("task Cruise "))
    );
    let refused = client.task_declaration(info.task_types).unwrap_err();
    assert_eq!(refused.refusal(), Some(LinkError::NoSuchIndex));
    let refused = client.running_blob().unwrap_err();
    assert_eq!(refused.refusal(), Some(LinkError::NoMission));
}

#[test]
fn over_a_bad_line_every_answer_is_the_right_one() {
    let (_board, line) = robot();
    let (mut client, info) = LinkClient::connect(line).unwrap();
    let expected = declarations(&mut client, &info);
    let LinkClient { link, .. } = client;
    let noisy = Noisy::new(link, Noise::of_each(Noise::WHOLE / 300), 11);
    let (mut client, info) = LinkClient::connect(noisy).unwrap();
    assert_eq!(declarations(&mut client, &info), expected);
    assert!(client.counts().retries > 0, "the line was too good to tell");
}

#[test]
fn over_a_bad_line_an_upload_arrives_as_it_was_sent() {
    let blob = junk(1500);
    for seed in 0..3 {
        let (_board, line) = robot();
        let noisy = Noisy::new(line, Noise::of_each(Noise::WHOLE / 300), seed);
        let (mut client, _) = LinkClient::connect(noisy).unwrap();
        let mut told = Vec::new();
        client.stage(&blob, &mut |bytes| told.push(bytes)).unwrap();
        assert_eq!(told.last(), Some(&blob.len()));
        // The robot looks at the checksum of the whole before it looks at what it means.
        let refused = client.commit().unwrap_err().refusal();
        assert_eq!(
            refused,
            Some(LinkError::Invalid(Refusal::Magic)),
            "seed {seed}"
        );
    }
}

#[test]
fn an_upload_goes_on_where_a_lost_client_left_it() {
    let blob = junk(1000);
    let (_board, line) = robot();
    let (mut client, _) = LinkClient::connect(line).unwrap();
    assert_eq!(client.begin(&blob).unwrap(), 0);
    assert_eq!(client.send_chunk(0, &blob[..100]).unwrap(), 100);
    let LinkClient { link, .. } = client;
    let (mut client, _) = LinkClient::connect(link).unwrap();
    let mut told = Vec::new();
    client.stage(&blob, &mut |bytes| told.push(bytes)).unwrap();
    assert_eq!(told.first(), Some(&100));
    let refused = client.commit().unwrap_err().refusal();
    assert_eq!(refused, Some(LinkError::Invalid(Refusal::Magic)));
    let refused = client.commit().unwrap_err().refusal();
    assert_eq!(refused, Some(LinkError::NoUpload), "it was forgotten");
}

#[test]
fn a_blob_that_is_too_long_is_refused_before_it_is_sent() {
    let (_board, line) = robot();
    let (mut client, info) = LinkClient::connect(line).unwrap();
    let length = info.capacities.blob_bytes as usize + 1;
    let before = client.counts().bytes_sent;
    let refused = client.stage(&junk(length), &mut |_| ()).unwrap_err();
    assert!(matches!(
        refused.refusal(),
        Some(LinkError::CapacityExceeded { .. })
    ));
    assert!(client.counts().bytes_sent - before < 100);
}

/// A line on which nothing that is sent arrives.
struct Deaf(PipeEnd);

impl ByteLink for Deaf {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.0.receive(buffer, timeout)
    }

    fn send(&mut self, _: &[u8]) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_robot_that_does_not_answer_is_given_up_in_time() {
    let (near, _far) = pipe::pair();
    let started = Instant::now();
    let error = LinkClient::connect(Deaf(near)).err().unwrap();
    assert!(matches!(error, ClientError::NoReply { .. }), "{error}");
    let took = started.elapsed();
    assert!(
        took >= REQUEST_DEADLINE && took < REQUEST_DEADLINE * 2,
        "{took:?}"
    );
}

#[test]
fn a_line_that_is_cut_is_told_at_once() {
    let (near, far) = pipe::pair();
    drop(far);
    let started = Instant::now();
    let error = LinkClient::connect(near).err().unwrap();
    assert!(matches!(error, ClientError::Line(_)), "{error}");
    assert!(started.elapsed() < Duration::from_secs(1));
}
