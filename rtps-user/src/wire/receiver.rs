//! The RTPS message receiver: follows INFO_DST, INFO_SRC and INFO_TS through a message (RTPS 2.5 section 8.3.4).

use super::{GuidPrefix, Header, Submessage, Submessages, Timestamp, WireError};

/// A submessage and what the message said before it.
#[derive(Clone, Debug, PartialEq)]
pub struct Received<'a> {
    /// The participant that it comes from.
    pub source: GuidPrefix,
    /// It names us as its destination.
    pub is_directed: bool,
    /// The source timestamp, if any.
    pub timestamp: Option<Timestamp>,
    /// The submessage; never an interpreter submessage.
    pub submessage: Submessage<'a>,
}

/// Iterates over the submessages of a message that are meant for one participant.
#[derive(Clone, Debug)]
pub struct MessageReceiver<'a> {
    own: GuidPrefix,
    header: Header,
    source: GuidPrefix,
    for_us: bool,
    is_directed: bool,
    timestamp: Option<Timestamp>,
    submessages: Submessages<'a>,
}

impl<'a> MessageReceiver<'a> {
    /// Begins to read `message` for the participant `own`.
    pub fn new(own: GuidPrefix, message: &'a [u8]) -> Result<Self, WireError> {
        let (header, submessages) = Submessages::parse(message)?;
        Ok(Self {
            own,
            header,
            source: header.prefix,
            for_us: true,
            is_directed: false,
            timestamp: None,
            submessages,
        })
    }

    /// The message's header.
    pub fn header(&self) -> &Header {
        &self.header
    }
}

impl<'a> Iterator for MessageReceiver<'a> {
    type Item = Result<Received<'a>, WireError>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.submessages.next()? {
                Err(error) => return Some(Err(error)),
                Ok(Submessage::InfoDestination(prefix)) => {
                    self.is_directed = prefix == self.own;
                    self.for_us = self.is_directed || prefix == GuidPrefix::UNKNOWN;
                }
                Ok(Submessage::InfoSource(prefix)) => {
                    self.source = prefix;
                    self.timestamp = None;
                }
                Ok(Submessage::InfoTimestamp(timestamp)) => self.timestamp = timestamp,
                Ok(Submessage::Skipped(_)) => {}
                Ok(submessage) if self.for_us => {
                    return Some(Ok(Received {
                        source: self.source,
                        is_directed: self.is_directed,
                        timestamp: self.timestamp,
                        submessage,
                    }));
                }
                Ok(_) => {}
            }
        }
    }
}
