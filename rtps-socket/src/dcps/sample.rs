//! A sample as a reader hands it out.

use rtps_user::reader::SampleInfo;

/// A value of a topic's type, or the news that an instance is no longer alive, with what is known of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample<T> {
    /// The value; none where only the state of the instance has changed.
    pub data: Option<T>,
    /// Without value: the instance, as a value whose key members are set, if its key is known.
    pub key: Option<T>,
    /// Its states, writer, time and more (DDS 1.4 section 2.2.2.5.5).
    pub info: SampleInfo,
}

impl<T> Sample<T> {
    /// The value, or else the one with only key members set.
    pub fn data_or_key(&self) -> Option<&T> {
        self.data.as_ref().or(self.key.as_ref())
    }
}
