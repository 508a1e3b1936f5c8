//! Type representation: what a type is, said so that another implementation understands it (DDS-XTypes 1.3 sections
//! 7.3.4 and 7.6.3).
//!
//! [`TypeBuilder`] makes the TypeObjects of a type, minimal and complete, from a [`Definition`] of it and of each type
//! it uses; a [`TypeIdentifier`] names one, by its hash or by spelling it out. Endpoints announce [`TypeInformation`];
//! the objects themselves are asked for with the messages of [`lookup`], kept in a [`TypeLibrary`] and compared by
//! [`TypeLibrary::is_assignable`].
//!
//! What comes from the wire is bounded: nesting, the number and the size of what is kept, and the steps of a comparison.

mod assignability;
mod builder;
mod definition;
mod identifier;
mod information;
mod library;
pub mod lookup;
mod object;
#[cfg(test)]
mod tests;
mod xcdr;

pub use assignability::Assignable;
pub use builder::{TypeBuilder, TypePair, TypeSupport};
pub use definition::{
    Bitfield, Bitflag, Definition, Extensibility, Literal, StructMember, TryConstruct, UnionMember,
};
pub use identifier::{Equivalence, TypeHash, TypeIdentifier, TypeKind};
pub use information::{Dependencies, TypeInformation};
pub use library::TypeLibrary;
