//! What a robot has counted of the links of its mission.

use esm_core::layout::Frame;
use esm_core::tables::Tables;
use esm_link::message::LinkError;
use esm_toolkit::counters::{FrameReport, LinkReport};
use esm_toolkit::inspect::{self, FrameRow, LinkRow};

use crate::link_client::{ClientError, LinkClient};
use crate::serial::ByteLink;

/// The links of a mission: how a robot is asked for what it has counted of each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct CountedLinks(Vec<CountedLink>);

/// A link of which nothing is counted, and the indices of its frames in the mission.
#[derive(Clone, Debug, PartialEq, Eq)]
struct CountedLink {
    report: LinkReport,
    indices: Vec<u16>,
}

impl CountedLinks {
    /// Of a mission, which [inspect](inspect::Report) has told these rows of.
    pub(crate) fn of(rows: Vec<LinkRow>, tables: &Tables<'_>) -> Self {
        let links = rows.into_iter().enumerate();
        CountedLinks(
            links
                .map(|(link, row)| CountedLink::of(link, row, tables))
                .collect(),
        )
    }

    /// Of a blob; none where it is none.
    pub(crate) fn of_blob(blob: &[u8]) -> Self {
        match esm_core::verify(blob.to_vec()) {
            Ok(verified) if !verified.tables().links().is_empty() => {
                let report = inspect::Report::of(&verified);
                CountedLinks::of(report.links, &verified.tables())
            }
            _ => CountedLinks::default(),
        }
    }

    /// Asks the robot, which runs the mission. None of a firmware that does not know of them.
    ///
    /// # Errors
    /// [`ClientError`]
    pub(crate) fn ask<L: ByteLink>(
        &self,
        robot: &mut LinkClient<L>,
    ) -> Result<Vec<LinkReport>, ClientError> {
        let reports: Result<Vec<_>, _> = self.0.iter().map(|link| link.ask(robot)).collect();
        match reports {
            Err(error)
                if matches!(
                    error.refusal(),
                    Some(LinkError::Malformed | LinkError::NotBuiltIn)
                ) =>
            {
                Ok(Vec::new())
            }
            reports => reports,
        }
    }
}

impl CountedLink {
    fn of(link: usize, row: LinkRow, tables: &Tables<'_>) -> Self {
        let index_of = |row: &FrameRow| {
            let is_it = |frame: &Frame| {
                frame.link.get() == link
                    && frame.identifier() == row.id
                    && frame.is_received() == (row.direction == "in")
            };
            let index = tables.frames().iter().position(is_it);
            // It was found there, among fewer frames than that.
            index.map_or(u16::MAX, |index| index as u16)
        };
        CountedLink {
            indices: row.frames.iter().map(index_of).collect(),
            report: LinkReport {
                link: row.link,
                frames: (row.frames.into_iter())
                    .map(|frame| FrameReport::new(frame.frame, frame.id, frame.direction))
                    .collect(),
                ..LinkReport::default()
            },
        }
    }

    fn ask<L: ByteLink>(&self, robot: &mut LinkClient<L>) -> Result<LinkReport, ClientError> {
        let mut report = self.report.clone();
        for (frame, index) in report.frames.iter_mut().zip(&self.indices) {
            let counters = robot.frame_counters(*index)?;
            frame.count(counters);
            (report.errors, report.dropped) = (counters.link_errors, counters.link_dropped);
        }
        Ok(report)
    }
}
