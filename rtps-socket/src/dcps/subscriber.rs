//! Subscriber (DDS 1.4 section 2.2.2.5.2).

use super::{DataReader, Topic};
use crate::cdr::DdsType;
use crate::error::CreateError;
use crate::qos::Qos;
use crate::socket::RtpsSocket;

/// Readers with PARTITION, PRESENTATION and GROUP_DATA in common.
#[derive(Clone)]
pub struct Subscriber {
    socket: RtpsSocket,
    qos: Qos,
}

impl Subscriber {
    pub(super) fn new(socket: RtpsSocket, qos: Qos) -> Self {
        Self { socket, qos }
    }

    /// A reader; where `qos` says nothing of partition, presentation and group data, the subscriber's hold.
    ///
    /// # Errors
    /// When the policies make no sense.
    pub fn create_reader<T: DdsType>(
        &self,
        topic: &Topic<T>,
        qos: Qos,
    ) -> Result<DataReader<T>, CreateError> {
        DataReader::new(&self.socket, topic, qos.in_group(&self.qos))
    }
}
