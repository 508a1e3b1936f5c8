//! Publisher (DDS 1.4 section 2.2.2.4.1).

use super::{DataWriter, Topic};
use crate::cdr::DdsType;
use crate::error::CreateError;
use crate::qos::Qos;
use crate::socket::RtpsSocket;

/// Writers with PARTITION, PRESENTATION and GROUP_DATA in common.
#[derive(Clone)]
pub struct Publisher {
    socket: RtpsSocket,
    qos: Qos,
}

impl Publisher {
    pub(super) fn new(socket: RtpsSocket, qos: Qos) -> Self {
        Self { socket, qos }
    }

    /// A writer; where `qos` says nothing of partition, presentation and group data, the publisher's hold.
    ///
    /// # Errors
    /// When the policies make no sense.
    pub fn create_writer<T: DdsType>(
        &self,
        topic: &Topic<T>,
        qos: Qos,
    ) -> Result<DataWriter<T>, CreateError> {
        DataWriter::new(&self.socket, topic, qos.in_group(&self.qos))
    }
}
