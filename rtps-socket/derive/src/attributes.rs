//! The `#[dds(...)]` attributes of types, fields and variants.

use md5::{Digest, Md5};
use proc_macro2::TokenStream;
use quote::{ToTokens, quote};
use syn::meta::ParseNestedMeta;
use syn::{Attribute, Expr, Ident, LitInt, LitStr, Path, Token};

use crate::discriminator::Label;

/// Member ids have 28 bits.
const MAX_MEMBER_ID: u32 = 0x0fff_ffff;

/// How the type may evolve.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Extensibility {
    Final,
    #[default]
    Appendable,
    Mutable,
}

impl ToTokens for Extensibility {
    fn to_tokens(&self, tokens: &mut TokenStream) {
        let cdr = crate::cdr();
        tokens.extend(match self {
            Self::Final => quote!(#cdr::Extensibility::Final),
            Self::Appendable => quote!(#cdr::Extensibility::Appendable),
            Self::Mutable => quote!(#cdr::Extensibility::Mutable),
        });
    }
}

/// A struct that is an integer on the wire.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bits {
    /// Of flags.
    Mask,
    /// Of small numbers.
    Set,
}

/// What becomes of a value that the member's type does not have, XTypes 7.2.2.7.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum TryConstruct {
    #[default]
    Discard,
    UseDefault,
    Trim,
}

impl TryConstruct {
    fn parse(item: &ParseNestedMeta<'_>) -> syn::Result<Self> {
        let literal: LitStr = item.value()?.parse()?;
        match literal.value().as_str() {
            "discard" => Ok(Self::Discard),
            "use_default" => Ok(Self::UseDefault),
            "trim" => Ok(Self::Trim),
            _ => Err(syn::Error::new_spanned(
                literal,
                "`try_construct` is \"discard\", \"use_default\" or \"trim\"",
            )),
        }
    }
}

impl ToTokens for TryConstruct {
    fn to_tokens(&self, tokens: &mut TokenStream) {
        let cdr = crate::cdr();
        tokens.extend(match self {
            Self::Discard => quote!(#cdr::TryConstruct::Discard),
            Self::UseDefault => quote!(#cdr::TryConstruct::UseDefault),
            Self::Trim => quote!(#cdr::TryConstruct::Trim),
        });
    }
}

/// Attributes of a struct or enum.
#[derive(Default)]
pub(crate) struct TypeAttributes {
    pub(crate) extensibility: Extensibility,
    pub(crate) bit_bound: Option<LitInt>,
    pub(crate) discriminator: Option<Path>,
    /// Members without an id have the hash of their name.
    pub(crate) autoid_hash: bool,
    /// What a struct without members of its own stands for.
    pub(crate) bits: Option<Bits>,
    /// Endpoints announce no type: they are matched by its name alone.
    pub(crate) by_name: bool,
    type_name: Option<LitStr>,
}

impl TypeAttributes {
    pub(crate) fn parse(attributes: &[Attribute]) -> syn::Result<Self> {
        let mut parsed = Self::default();
        for_each_item(attributes, |item| {
            if item.path.is_ident("final") {
                parsed.extensibility = Extensibility::Final;
            } else if item.path.is_ident("appendable") {
                parsed.extensibility = Extensibility::Appendable;
            } else if item.path.is_ident("mutable") {
                parsed.extensibility = Extensibility::Mutable;
            } else if item.path.is_ident("type_name") {
                parsed.type_name = Some(item.value()?.parse()?);
            } else if item.path.is_ident("bit_bound") {
                parsed.bit_bound = Some(item.value()?.parse()?);
            } else if item.path.is_ident("discriminator") {
                parsed.discriminator = Some(item.value()?.parse::<LitStr>()?.parse()?);
            } else if item.path.is_ident("by_name") {
                parsed.by_name = true;
            } else if item.path.is_ident("autoid") {
                parsed.autoid_hash = autoid_hash(&item)?;
            } else if item.path.is_ident("bitmask") {
                parsed.bits = Some(Bits::Mask);
            } else if item.path.is_ident("bitset") {
                parsed.bits = Some(Bits::Set);
            } else {
                return Err(item.error(
                    "a type takes `final`, `appendable`, `mutable`, `type_name`, `bit_bound`, \
                     `discriminator`, `autoid`, `bitmask`, `bitset` or `by_name`",
                ));
            }
            Ok(())
        })?;
        Ok(parsed)
    }

    /// The registered type name; without one given, the Rust name.
    pub(crate) fn type_name(&self, ident: &Ident) -> String {
        idl_name(self.type_name.as_ref(), ident)
    }
}

/// The name that was given, or else the Rust name.
pub(crate) fn idl_name(given: Option<&LitStr>, ident: &Ident) -> String {
    match given {
        Some(name) => name.value(),
        None => ident.to_string().trim_start_matches("r#").to_owned(),
    }
}

/// Attributes of a struct's field.
#[derive(Default)]
pub(crate) struct FieldAttributes {
    pub(crate) key: bool,
    pub(crate) id: Option<u32>,
    pub(crate) bound: Option<Expr>,
    /// `u8` stands for IDL's `uint8` and not for `octet`.
    pub(crate) uint8: bool,
    pub(crate) name: Option<LitStr>,
    pub(crate) default: Option<Expr>,
    pub(crate) non_serialized: bool,
    /// The members of its type are inherited.
    pub(crate) base: bool,
    /// The name that the id is made of, empty for the member's own.
    pub(crate) hash_id: Option<String>,
    pub(crate) must_understand: bool,
    pub(crate) external: bool,
    pub(crate) try_construct: TryConstruct,
    /// The least significant bit of a bitmask's flag or a bitset's field.
    pub(crate) position: Option<LitInt>,
    /// How many bits a bitset's field has.
    pub(crate) bits: Option<LitInt>,
}

impl FieldAttributes {
    pub(crate) fn parse(attributes: &[Attribute]) -> syn::Result<Self> {
        let mut parsed = Self::default();
        for_each_item(attributes, |item| {
            if item.path.is_ident("key") {
                parsed.key = true;
            } else if item.path.is_ident("id") {
                parsed.id = Some(member_id(&item)?);
            } else if item.path.is_ident("bound") {
                parsed.bound = Some(item.value()?.parse()?);
            } else if item.path.is_ident("default") {
                parsed.default = Some(item.value()?.parse()?);
            } else if item.path.is_ident("non_serialized") {
                parsed.non_serialized = true;
            } else if item.path.is_ident("uint8") {
                parsed.uint8 = true;
            } else if item.path.is_ident("name") {
                parsed.name = Some(item.value()?.parse()?);
            } else if item.path.is_ident("base") {
                parsed.base = true;
            } else if item.path.is_ident("hashid") {
                let has_name = item.input.peek(Token![=]);
                let name = has_name.then(|| item.value()?.parse::<LitStr>());
                parsed.hash_id = Some(name.transpose()?.map_or_else(String::new, |n| n.value()));
            } else if item.path.is_ident("must_understand") {
                parsed.must_understand = true;
            } else if item.path.is_ident("external") {
                parsed.external = true;
            } else if item.path.is_ident("try_construct") {
                parsed.try_construct = TryConstruct::parse(&item)?;
            } else if item.path.is_ident("position") {
                parsed.position = Some(item.value()?.parse()?);
            } else if item.path.is_ident("bits") {
                parsed.bits = Some(item.value()?.parse()?);
            } else if item.path.is_ident("optional") {
                return Err(item.error("a member is optional when its type is `Option<...>`"));
            } else {
                return Err(item.error(
                    "a field takes `key`, `id`, `hashid`, `name`, `bound`, `uint8`, `default = expression`, \
                     `try_construct`, `must_understand`, `external`, `base` or `non_serialized`, and of \
                     a bitmask or bitset `position` and `bits`",
                ));
            }
            Ok(())
        })?;
        Ok(parsed)
    }
}

/// Attributes of an enum's variant.
#[derive(Default)]
pub(crate) struct VariantAttributes {
    pub(crate) cases: Vec<Label>,
    pub(crate) default: bool,
    pub(crate) uint8: bool,
    pub(crate) name: Option<LitStr>,
}

impl VariantAttributes {
    pub(crate) fn parse(attributes: &[Attribute]) -> syn::Result<Self> {
        let mut parsed = Self::default();
        for_each_item(attributes, |item| {
            if item.path.is_ident("case") {
                parsed.cases.push(item.value()?.parse()?);
            } else if item.path.is_ident("default") {
                parsed.default = true;
            } else if item.path.is_ident("uint8") {
                parsed.uint8 = true;
            } else if item.path.is_ident("name") {
                parsed.name = Some(item.value()?.parse()?);
            } else {
                return Err(item.error("a variant takes `case`, `default`, `name` or `uint8`"));
            }
            Ok(())
        })?;
        Ok(parsed)
    }
}

fn autoid_hash(item: &ParseNestedMeta<'_>) -> syn::Result<bool> {
    let literal: LitStr = item.value()?.parse()?;
    match literal.value().as_str() {
        "hash" => Ok(true),
        "sequential" => Ok(false),
        _ => Err(syn::Error::new_spanned(
            literal,
            "`autoid` is \"sequential\" or \"hash\"",
        )),
    }
}

/// The id that a name hashes to, XTypes 7.3.1.2.1.1.
pub(crate) fn hashed_id(name: &str) -> u32 {
    let [a, b, c, d, ..]: [u8; 16] = Md5::digest(name).into();
    u32::from_le_bytes([a, b, c, d]) & MAX_MEMBER_ID
}

fn member_id(item: &ParseNestedMeta<'_>) -> syn::Result<u32> {
    let literal: LitInt = item.value()?.parse()?;
    let id = literal.base10_parse()?;
    if id > MAX_MEMBER_ID {
        return Err(syn::Error::new_spanned(
            literal,
            "a member id is at most 0x0fffffff",
        ));
    }
    Ok(id)
}

fn for_each_item(
    attributes: &[Attribute],
    mut each: impl FnMut(ParseNestedMeta<'_>) -> syn::Result<()>,
) -> syn::Result<()> {
    attributes
        .iter()
        .filter(|attribute| attribute.path().is_ident("dds"))
        .try_for_each(|attribute| attribute.parse_nested_meta(&mut each))
}
