//! Topic (DDS 1.4 section 2.2.2.3.2).

use std::marker::PhantomData;

use crate::cdr::DdsType;
use crate::error::CreateError;
use crate::qos::Qos;

/// A name under which samples of one type are exchanged, with policies that its endpoints may take over.
#[derive(Debug)]
pub struct Topic<T> {
    name: String,
    qos: Qos,
    sample: PhantomData<fn() -> T>,
}

impl<T> Clone for Topic<T> {
    fn clone(&self) -> Self {
        Self {
            name: self.name.clone(),
            qos: self.qos.clone(),
            sample: PhantomData,
        }
    }
}

impl<T: DdsType> Topic<T> {
    pub(super) fn new(name: &str, qos: Qos) -> Result<Self, CreateError> {
        if !Self::is_name(name) {
            return Err(CreateError::InvalidName(name.to_owned()));
        }
        qos.check().map_err(CreateError::Inconsistent)?;
        Ok(Self {
            name: name.to_owned(),
            qos,
            sample: PhantomData,
        })
    }

    /// 1 to 255 bytes without NUL.
    pub(super) fn is_name(name: &str) -> bool {
        !name.is_empty() && name.len() <= 255 && !name.contains('\0')
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its policies: what a writer or reader may be created with. Without that TOPIC_DATA alone holds for them, where they
    /// say nothing of it.
    pub fn qos(&self) -> &Qos {
        &self.qos
    }

    /// The registered name of its type.
    pub fn type_name(&self) -> &'static str {
        T::TYPE_NAME
    }
}
