//! DataWriter (DDS 1.4 section 2.2.2.4.2).

use std::cell::RefCell;
use std::marker::PhantomData;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use rtps_user::history::ChangeKind;
use rtps_user::qos::DataRepresentation;
use rtps_user::wire::{Guid, KeyHash, PayloadKind, SequenceNumber};

use super::EndpointBuiltinTopicData;
use super::access::instance_of_payload;
use super::instance_of;
use super::keys::Keys;
use crate::cdr::{DdsType, EncodeError, Representation, bare_key_of, key_payload, to_payload};
use crate::error::{CreateError, SetQosError, WaitError, WriteError};
use crate::filter::announced_filter;
use crate::qos::{Qos, policies};
use crate::socket::{Loan, RawChange, RawWriter, RtpsSocket, Template};

/// Payloads up to this size are serialized into a buffer that is used again, and copied; larger ones keep theirs.
const COPIED: usize = 4096;

thread_local! {
    /// For serialized samples and keys.
    static BUFFERS: RefCell<(Vec<u8>, Vec<u8>)> = const { RefCell::new((Vec::new(), Vec::new())) };
}

/// A writer of samples of type `T`. Dropped, it is withdrawn: samples that readers still lack are gone.
pub struct DataWriter<T> {
    pub(super) writer: RawWriter,
    representation: Representation,
    /// Of the instances whose handles the app has asked for.
    keys: Keys,
    sample: PhantomData<fn(&T)>,
}

impl<T: DdsType> DataWriter<T> {
    pub(super) fn new(socket: &RtpsSocket, mut template: Template) -> Result<Self, CreateError> {
        let representation = match template.qos.representation.first() {
            None | Some(DataRepresentation::Xcdr1) => Representation::Xcdr1,
            Some(DataRepresentation::Xcdr2) => Representation::Xcdr2,
            Some(DataRepresentation::Xml) => return Err(CreateError::UnsupportedRepresentation),
        };
        template.describe::<T>();
        template.make_filter = Some(announced_filter::<T>);
        template.bare_key = bare_key_of::<T>(representation);
        Ok(Self {
            writer: socket.create_writer_of(template, T::HAS_KEY)?,
            representation,
            keys: Keys::default(),
            sample: PhantomData,
        })
    }

    /// Writes a sample, from the caller's thread. While the history of a reliable KEEP_ALL writer is full it waits,
    /// up to the writer's max_blocking_time.
    ///
    /// # Errors
    /// When the value cannot be serialized, or the history has no room for it.
    pub fn write(&self, value: &T) -> Result<SequenceNumber, WriteError> {
        self.change(ChangeKind::Alive, value, None)
    }

    /// Writes a sample with a source timestamp of its own.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_at(&self, value: &T, timestamp: SystemTime) -> Result<SequenceNumber, WriteError> {
        self.change(ChangeKind::Alive, value, Some(timestamp))
    }

    /// Lends a buffer for a sample that is serialized elsewhere, `len` bytes with the encapsulation header.
    pub fn loan(&self, len: usize) -> Loan {
        self.writer.loan(len)
    }

    /// Writes the sample that was serialized into a loan, which is not copied into the history. Of a topic with key it
    /// is read, to find its instance.
    ///
    /// # Errors
    /// As [`write`](Self::write), and when the topic has a key and there is no sample in the loan.
    pub fn write_loaned(&self, loan: Loan) -> Result<SequenceNumber, WriteError> {
        let instance = match T::HAS_KEY {
            true => instance_of_payload::<T>()(PayloadKind::Data, &loan)
                .ok_or(WriteError::NoSample(T::TYPE_NAME))?,
            false => KeyHash::default(),
        };
        self.writer.send_loaned(loan, instance)
    }

    /// Disposes the instance that `value` belongs to; only its key members count.
    ///
    /// # Errors
    /// As [`write`](Self::write), and when the topic has no key.
    pub fn dispose(&self, value: &T) -> Result<SequenceNumber, WriteError> {
        self.end(ChangeKind::Disposed, value, None)
    }

    /// Disposes an instance with a source timestamp of its own.
    ///
    /// # Errors
    /// As [`dispose`](Self::dispose).
    pub fn dispose_at(
        &self,
        value: &T,
        timestamp: SystemTime,
    ) -> Result<SequenceNumber, WriteError> {
        self.end(ChangeKind::Disposed, value, Some(timestamp))
    }

    /// Disposes the instance with this handle.
    ///
    /// # Errors
    /// As [`dispose`](Self::dispose), and when the handle is of no instance of this writer.
    pub fn dispose_instance(&self, instance: KeyHash) -> Result<SequenceNumber, WriteError> {
        self.dispose(&self.registered(instance)?)
    }

    /// Says that this writer will not write the instance that `value` belongs to any more. Unless
    /// WRITER_DATA_LIFECYCLE says otherwise, that disposes the instance, too.
    ///
    /// # Errors
    /// As [`write`](Self::write), and when the topic has no key.
    pub fn unregister(&self, value: &T) -> Result<SequenceNumber, WriteError> {
        self.end(ChangeKind::Unregistered, value, None)
    }

    /// Unregisters an instance with a source timestamp of its own.
    ///
    /// # Errors
    /// As [`unregister`](Self::unregister).
    pub fn unregister_at(
        &self,
        value: &T,
        timestamp: SystemTime,
    ) -> Result<SequenceNumber, WriteError> {
        self.end(ChangeKind::Unregistered, value, Some(timestamp))
    }

    /// Unregisters the instance with this handle, which is over then.
    ///
    /// # Errors
    /// As [`unregister`](Self::unregister), and when the handle is of no instance of this writer.
    pub fn unregister_instance(&self, instance: KeyHash) -> Result<SequenceNumber, WriteError> {
        let sequence = self.unregister(&self.registered(instance)?)?;
        self.keys.forget(instance);
        Ok(sequence)
    }

    /// Registers the instance that `value` belongs to, which writing does as well, and gives its handle.
    ///
    /// # Errors
    /// When the topic has no key, the key cannot be serialized, or max_instances leaves no place.
    pub fn register_instance(&self, value: &T) -> Result<KeyHash, WriteError> {
        if !T::HAS_KEY {
            return Err(WriteError::NoKey);
        }
        let instance = instance_of(value, self.representation, &mut Vec::new())?;
        self.writer.register_instance(instance)?;
        // The app names them one by one, and unregisters them.
        self.keys.note(instance, value, |_| {});
        Ok(instance)
    }

    /// The handle of the instance that `value` belongs to, if it has been registered or written and not been
    /// unregistered. Where neither max_instances nor DEADLINE asks for a book of them, what was written counts as
    /// long as it is in the history.
    pub fn lookup_instance(&self, value: &T) -> Option<KeyHash> {
        if !T::HAS_KEY {
            return None;
        }
        let instance = instance_of(value, self.representation, &mut Vec::new()).ok()?;
        if !self.keys.contains(instance) {
            if !self.writer.is_registered(instance) {
                return None;
            }
            self.keys.note(instance, value, |_| {});
        }
        Some(instance)
    }

    /// A value of which only the key members are set, those of a registered instance.
    pub fn key_value(&self, instance: KeyHash) -> Option<T> {
        self.keys.value(instance).ok().flatten()
    }

    fn registered(&self, instance: KeyHash) -> Result<T, WriteError> {
        self.key_value(instance).ok_or(WriteError::UnknownInstance)
    }

    fn end(
        &self,
        kind: ChangeKind,
        value: &T,
        timestamp: Option<SystemTime>,
    ) -> Result<SequenceNumber, WriteError> {
        match T::HAS_KEY {
            true => self.change(kind, value, timestamp),
            false => Err(WriteError::NoKey),
        }
    }

    fn change(
        &self,
        kind: ChangeKind,
        value: &T,
        timestamp: Option<SystemTime>,
    ) -> Result<SequenceNumber, WriteError> {
        let (payload, instance) = BUFFERS.with_borrow_mut(|(payload, key)| {
            let instance = instance_of(value, self.representation, key)?;
            Ok::<_, EncodeError>((self.serialize(kind, value, payload)?, instance))
        })?;
        self.writer.send_change(RawChange {
            kind,
            instance,
            payload,
            timestamp,
        })
    }

    fn serialize(
        &self,
        kind: ChangeKind,
        value: &T,
        buffer: &mut Vec<u8>,
    ) -> Result<Bytes, EncodeError> {
        buffer.clear();
        match kind {
            ChangeKind::Alive => to_payload(value, self.representation, buffer)?,
            _ => key_payload(value, self.representation, buffer)?,
        }
        match buffer.len() {
            ..=COPIED => Ok(Bytes::copy_from_slice(buffer)),
            _ => Ok(Bytes::from(std::mem::take(buffer))),
        }
    }

    /// Its name.
    pub fn guid(&self) -> Guid {
        self.writer.guid()
    }

    /// The readers that it is matched with.
    pub fn matched(&self) -> Vec<Guid> {
        self.writer.matched()
    }

    /// What is known of a reader that it is matched with.
    pub fn matched_subscription_data(&self, reader: Guid) -> Option<EndpointBuiltinTopicData> {
        self.writer.matched_subscription_data(reader)
    }

    /// Waits until at least `count` readers are matched.
    ///
    /// # Errors
    /// When there are fewer after `timeout`.
    pub fn wait_for_matched(&self, count: usize, timeout: Duration) -> Result<(), WaitError> {
        self.writer.wait_for_matched(count, timeout)
    }

    /// Waits until every reliable reader has acknowledged everything.
    ///
    /// # Errors
    /// When one has not after `timeout`.
    pub fn wait_for_acknowledgments(&self, timeout: Duration) -> Result<(), WaitError> {
        self.writer.wait_for_acknowledgments(timeout)
    }

    /// Asserts that the writer is alive, where LIVELINESS is manual; of MANUAL_BY_PARTICIPANT all of the participant's are then.
    /// Writing does as well.
    pub fn assert_liveliness(&self) {
        self.writer.assert_liveliness();
    }

    /// Its policies, with those of its publisher.
    pub fn qos(&self) -> policies::Qos {
        self.writer.qos()
    }

    /// Changes its policies, and has others learn of it: USER_DATA, DEADLINE, LATENCY_BUDGET, OWNERSHIP_STRENGTH,
    /// LIFESPAN, TRANSPORT_PRIORITY, WRITER_DATA_LIFECYCLE and, where it has no publisher, PARTITION.
    ///
    /// # Errors
    /// When a policy is among them that may not change, or that makes no sense.
    pub fn set_qos(&self, qos: Qos) -> Result<(), SetQosError> {
        self.writer.set_qos(qos)
    }

    /// Has others learn of the writer, where it was created not to be known yet; only then can it write.
    pub fn enable(&self) {
        self.writer.enable();
    }
}
