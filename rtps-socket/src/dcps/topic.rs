//! Topic (DDS 1.4 section 2.2.2.3.2).

use std::marker::PhantomData;

use crate::cdr::DdsType;
use crate::error::CreateError;

/// A name under which samples of one type are exchanged.
#[derive(Clone, Debug)]
pub struct Topic<T> {
    name: String,
    sample: PhantomData<fn() -> T>,
}

impl<T: DdsType> Topic<T> {
    pub(super) fn new(name: &str) -> Result<Self, CreateError> {
        if name.is_empty() || name.len() > 255 || name.contains('\0') {
            return Err(CreateError::InvalidName(name.to_owned()));
        }
        Ok(Self {
            name: name.to_owned(),
            sample: PhantomData,
        })
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
