//! A blob that arrives, and the buffers for blobs.
//!
//! *Invariant:* a buffer is here, in an upload, or with a mission.

use esm_core::BlobBuffer;

use super::handler::{RequestHandler, Upload};
use super::port::LinkPort;
use esm_link::message::{Capacity, LinkError, Response};

impl<'m> RequestHandler<'_, 'm> {
    pub(super) fn begin(
        &mut self,
        len: u32,
        crc: u32,
        port: &mut impl LinkPort,
    ) -> Result<Response<'_>, LinkError> {
        self.refuse_on_trial()?;
        // Whose trial has just ended has given its buffer back before it said so.
        self.take_freed(port);
        let resumed = self.upload.as_ref().filter(|upload| {
            let is_same_len = upload.len == len || mutant!(OtherLengthResumed);
            let is_same_blob = upload.crc == crc || mutant!(OtherBlobResumed);
            is_same_len && is_same_blob
        });
        if let Some(upload) = resumed {
            return Ok(Response::Received {
                len: upload.received(),
            });
        }
        if len > self.capacities.blob_bytes && !mutant!(CapacityForgotten) {
            return Err(LinkError::CapacityExceeded {
                what: Capacity::BlobBytes,
                needed: len,
                available: self.capacities.blob_bytes,
            });
        }
        self.end_upload();
        let mut blob = self
            .blobs
            .iter_mut()
            .find_map(Option::take)
            .ok_or(LinkError::Busy)?;
        blob.clear();
        self.upload = Some(Upload {
            blob,
            len,
            crc,
            signed: None,
        });
        Ok(Response::Received { len: 0 })
    }

    pub(super) fn chunk(&mut self, offset: u32, data: &[u8]) -> Result<Response<'_>, LinkError> {
        let upload = self.upload.as_mut().ok_or(LinkError::NoUpload)?;
        let received = upload.received();
        // What came before is passed over: it was sent again because its answer was lost, or late.
        let known = received
            .checked_sub(if mutant!(GapTaken) {
                offset.min(received)
            } else {
                offset
            })
            .ok_or(LinkError::WrongOffset { expected: received })?;
        let known = if mutant!(OverlapRepeated) { 0 } else { known };
        let data = data.get(known as usize..).unwrap_or_default();
        let is_too_long = data.len() as u32 > upload.len - received && !mutant!(LengthForgotten);
        if is_too_long || !upload.blob.push(data) {
            return Err(LinkError::TooLong);
        }
        Ok(Response::Received {
            len: upload.received(),
        })
    }

    pub(super) fn end_upload(&mut self) {
        if let Some(upload) = self.upload.take() {
            self.keep(upload.blob);
        }
    }

    /// Puts a buffer back.
    pub(super) fn keep(&mut self, blob: BlobBuffer<'m>) {
        if let Some(place) = self.blobs.iter_mut().find(|place| place.is_none()) {
            *place = Some(blob);
        }
    }

    /// The buffer for the next mission holds the one before as long as one is on trial.
    pub(super) fn refuse_on_trial(&self) -> Result<(), LinkError> {
        let health = self.snapshot.read().ok_or(LinkError::NoAnswer)?;
        health.trial.map_or(Ok(()), |_| Err(LinkError::OnTrial))
    }
}
