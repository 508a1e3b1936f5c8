//! Topic (DDS 1.4 section 2.2.2.3.2).

use std::marker::PhantomData;

use crate::cdr::DdsType;
use crate::error::CreateError;

/// A name under which samples of one type are exchanged.
#[derive(Debug)]
pub struct Topic<T> {
    name: String,
    sample: PhantomData<fn() -> T>,
}

impl<T> Clone for Topic<T> {
    fn clone(&self) -> Self {
        Self {
            name: self.name.clone(),
            sample: PhantomData,
        }
    }
}

impl<T: DdsType> Topic<T> {
    pub(super) fn new(name: &str) -> Result<Self, CreateError> {
        if !Self::is_name(name) {
            return Err(CreateError::InvalidName(name.to_owned()));
        }
        Ok(Self {
            name: name.to_owned(),
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

    /// The registered name of its type.
    pub fn type_name(&self) -> &'static str {
        T::TYPE_NAME
    }
}
