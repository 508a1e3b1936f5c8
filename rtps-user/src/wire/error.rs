//! Why a datagram, or a part of it, was refused.

use thiserror::Error;

/// What is wrong with bytes from the wire.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
#[non_exhaustive]
pub enum WireError {
    /// A value needs more bytes than there are.
    #[error("the bytes end in the middle of a value")]
    UnexpectedEnd,
    /// The first four bytes are not "RTPS".
    #[error("not an RTPS message")]
    NotRtps,
    /// A major protocol version other than 2.
    #[error("RTPS protocol version {0} is not supported")]
    UnsupportedVersion(u8),
    /// A submessage announces more bytes than the message has.
    #[error("a submessage is longer than the rest of its message")]
    SubmessageTooLong,
    /// A set of numbers has more than 256 bits, or its base is not positive.
    #[error("a sequence-number or fragment-number set is invalid")]
    InvalidSet,
    /// A sequence number, count or range that RTPS 8.3.7 calls invalid.
    #[error("a sequence-number range is invalid")]
    InvalidRange,
    /// Fragment size, number or count do not fit the sample (RTPS 8.3.8.3).
    #[error("a fragment does not fit its sample")]
    InvalidFragment,
    /// The inline QoS starts or ends outside of its submessage, or payload flags contradict each other.
    #[error("the flags of a DATA submessage contradict its length")]
    InvalidData,
    /// A parameter list has no sentinel, or a parameter runs over its end (RTPS 9.4.2.11).
    #[error("a parameter list is malformed")]
    InvalidParameterList,
    /// A string has no terminating NUL or is not UTF-8.
    #[error("a string is malformed")]
    InvalidString,
}
