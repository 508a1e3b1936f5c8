//! The discriminator of a union: its type, and the values that select a member.

use proc_macro2::{Literal, TokenStream};
use quote::{ToTokens, quote};
use syn::parse::{Parse, ParseStream};
use syn::{Error, Lit, LitBool, LitChar, LitInt, Path, Token};

use crate::attributes::TypeAttributes;

const INTEGERS: [&str; 8] = ["i8", "u8", "i16", "u16", "i32", "u32", "i64", "u64"];

/// The type of a discriminator.
pub(crate) enum Discriminator {
    Integer(Path),
    Bool(Path),
    Char(Path),
    /// An enumeration.
    Enum(Path),
}

impl Discriminator {
    pub(crate) fn parse(attributes: &TypeAttributes) -> syn::Result<Self> {
        if let Some(literal) = &attributes.bit_bound {
            return Err(Error::new_spanned(
                literal,
                "`bit_bound` is for enumerations; a union has a `discriminator`",
            ));
        }
        let Some(path) = attributes.discriminator.clone() else {
            return Ok(Self::Integer(syn::parse_quote!(i32)));
        };
        Ok(match path.get_ident().map(ToString::to_string) {
            Some(name) if INTEGERS.contains(&name.as_str()) => Self::Integer(path),
            Some(name) if name == "bool" => Self::Bool(path),
            Some(name) if name == "char" => Self::Char(path),
            _ => Self::Enum(path),
        })
    }

    /// A value that none of `taken` is, for the default; an enumeration's are not known here.
    pub(crate) fn unused(&self, taken: &[Label]) -> Option<Label> {
        let is_free = |label: &Label| !taken.contains(label);
        match self {
            Self::Integer(_) => (0..).map(Label::Number).find(is_free),
            Self::Bool(_) => [false, true].map(Label::Bool).into_iter().find(is_free),
            Self::Char(_) => ('\0'..='\u{ff}').map(Label::Char).find(is_free),
            Self::Enum(_) => None,
        }
    }

    /// The number of the value `other`.
    pub(crate) fn number(&self) -> TokenStream {
        match self {
            Self::Integer(_) | Self::Bool(_) => quote!(other.into()),
            Self::Char(_) => quote!(u32::from(other).into()),
            Self::Enum(_) => quote!((other as i32).into()),
        }
    }
}

impl ToTokens for Discriminator {
    fn to_tokens(&self, tokens: &mut TokenStream) {
        match self {
            Self::Integer(path) | Self::Bool(path) | Self::Char(path) | Self::Enum(path) => {
                path.to_tokens(tokens);
            }
        }
    }
}

/// A value of a discriminator.
#[derive(Clone, PartialEq)]
pub(crate) enum Label {
    Number(i128),
    Bool(bool),
    Char(char),
    /// A value of an enumeration.
    Named(Path),
}

impl Label {
    /// The value in a TypeObject, where it fits.
    pub(crate) fn object_value(&self) -> Option<TokenStream> {
        Some(match self {
            Self::Number(number) => i32::try_from(*number).ok()?.to_token_stream(),
            Self::Bool(value) => i32::from(*value).to_token_stream(),
            Self::Char(value) => i32::try_from(u32::from(*value)).ok()?.to_token_stream(),
            Self::Named(path) => quote!(#path as i32),
        })
    }
}

impl Parse for Label {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        if input.peek(LitBool) || input.peek(LitChar) {
            return match input.parse()? {
                Lit::Bool(value) => Ok(Self::Bool(value.value)),
                Lit::Char(value) => Ok(Self::Char(value.value())),
                other => Err(Error::new_spanned(other, "a case is no such literal")),
            };
        }
        let negative = input.parse::<Option<Token![-]>>()?.is_some();
        if !negative && !input.peek(LitInt) {
            return input.parse().map(Self::Named);
        }
        let number: i128 = input.parse::<LitInt>()?.base10_parse()?;
        Ok(Self::Number(if negative { -number } else { number }))
    }
}

/// The value as expression and as pattern.
impl ToTokens for Label {
    fn to_tokens(&self, tokens: &mut TokenStream) {
        match self {
            Self::Number(number) => {
                let magnitude = Literal::u128_unsuffixed(number.unsigned_abs());
                let sign = (*number < 0).then(|| quote!(-));
                tokens.extend(quote!(#sign #magnitude));
            }
            Self::Bool(value) => value.to_tokens(tokens),
            Self::Char(value) => value.to_tokens(tokens),
            Self::Named(path) => path.to_tokens(tokens),
        }
    }
}
