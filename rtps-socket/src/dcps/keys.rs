//! The keys of instances, so that a handle leads back to a value.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use rtps_user::wire::KeyHash;

use crate::cdr::{DdsType, DecodeError, Representation, from_key_payload, key_payload};

/// From so many keys on those of instances that are no more are looked for.
const FEW: usize = 1024;

/// Serialized keys by instance.
#[derive(Debug)]
pub(super) struct Keys {
    known: Mutex<Known>,
}

#[derive(Debug)]
struct Known {
    keys: HashMap<KeyHash, Bytes>,
    /// With so many keys it is time to tidy up.
    limit: usize,
}

impl Default for Keys {
    fn default() -> Self {
        Self {
            known: Mutex::new(Known {
                keys: HashMap::new(),
                limit: FEW,
            }),
        }
    }
}

impl Keys {
    /// Notes the key of a value. Where there are many keys, `retain` is to drop those that nobody will ask for.
    pub(super) fn note<T: DdsType>(
        &self,
        instance: KeyHash,
        value: &T,
        retain: impl FnOnce(&mut HashMap<KeyHash, Bytes>),
    ) {
        let mut known = self.lock();
        if known.keys.contains_key(&instance) {
            return;
        }
        let mut key = Vec::new();
        // What was decoded can be encoded; else only the key of a later dispose is missing.
        if key_payload(value, Representation::Xcdr2, &mut key).is_err() {
            return;
        }
        if known.keys.len() >= known.limit {
            retain(&mut known.keys);
            known.limit = (2 * known.keys.len()).max(FEW);
        }
        known.keys.insert(instance, key.into());
    }

    /// A value of the instance with only its key members set, if its key is known.
    ///
    /// # Errors
    /// When the key cannot be read.
    pub(super) fn value<T: DdsType>(&self, instance: KeyHash) -> Result<Option<T>, DecodeError> {
        let known = self.lock();
        let key = known.keys.get(&instance);
        key.map(|key| from_key_payload(key)).transpose()
    }

    /// Whether the key of an instance is known.
    pub(super) fn contains(&self, instance: KeyHash) -> bool {
        self.lock().keys.contains_key(&instance)
    }

    /// Forgets the key of an instance.
    pub(super) fn forget(&self, instance: KeyHash) {
        self.lock().keys.remove(&instance);
    }

    fn lock(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
