//! The `#[dds(...)]` attributes of types, fields and variants.

use proc_macro2::TokenStream;
use quote::{ToTokens, quote};
use syn::meta::ParseNestedMeta;
use syn::{Attribute, Expr, Ident, LitInt, LitStr, Path};

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

/// Attributes of a struct or enum.
#[derive(Default)]
pub(crate) struct TypeAttributes {
    pub(crate) extensibility: Extensibility,
    pub(crate) bit_bound: Option<LitInt>,
    pub(crate) discriminator: Option<Path>,
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
            } else {
                return Err(item.error(
                    "a type takes `final`, `appendable`, `mutable`, `type_name`, `bit_bound`, \
                     `discriminator` or `by_name`",
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
            } else if item.path.is_ident("optional") {
                return Err(item.error("a member is optional when its type is `Option<...>`"));
            } else {
                return Err(item.error(
                    "a field takes `key`, `id`, `name`, `bound`, `uint8`, `default = expression` or \
                     `non_serialized`",
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
