//! Enumerations: enums without data, encoded as an integer of their bit bound.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::{DataEnum, DeriveInput, Error, Ident};

use crate::attributes::{TypeAttributes, VariantAttributes};

pub(crate) fn expand(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    data: &DataEnum,
) -> syn::Result<TokenStream> {
    let cdr = crate::cdr();
    let ident = &input.ident;
    let type_name = attributes.type_name(ident);
    let holder = holder(attributes)?;
    let default = default_literal(data)?;
    let literals: Vec<_> = data.variants.iter().map(|variant| &variant.ident).collect();
    let first = &data.variants[0].ident;
    let initial = default.unwrap_or(first);
    let unknown = match default {
        Some(default) => quote!(Ok(Self::#default)),
        None => quote! {
            Err(#cdr::DecodeError::InvalidEnum { type_name: #type_name, value: value.into() })
        },
    };
    let field_access = crate::fields::of_enumeration(ident, &literals);
    Ok(quote! {
        #[automatically_derived]
        impl #cdr::CdrType for #ident {
            const MIN_SIZE: usize = <#holder as #cdr::CdrType>::MIN_SIZE;
            const LENGTH_CODE: #cdr::LengthCode = <#holder as #cdr::CdrType>::LENGTH_CODE;

            fn encode(
                &self,
                encoder: &mut #cdr::Encoder<'_>,
            ) -> ::core::result::Result<(), #cdr::EncodeError> {
                let value = match self { #(Self::#literals => Self::#literals as #holder,)* };
                #cdr::CdrType::encode(&value, encoder)
            }

            fn decode(
                decoder: &mut #cdr::Decoder<'_>,
            ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                let value: #holder = #cdr::CdrType::decode(decoder)?;
                match value {
                    #(value if value == Self::#literals as #holder => Ok(Self::#literals),)*
                    value => #unknown,
                }
            }

            fn default_value() -> Self { Self::#initial }

            fn add_key_size(size: &mut #cdr::KeySize) {
                <#holder as #cdr::CdrType>::add_key_size(size);
            }

            #field_access
        }
    })
}

/// The integer that the bit bound selects, XTypes 7.4.3.5.
fn holder(attributes: &TypeAttributes) -> syn::Result<Ident> {
    let Some(literal) = &attributes.bit_bound else {
        return Ok(format_ident!("i32"));
    };
    match literal.base10_parse()? {
        1..=8u32 => Ok(format_ident!("i8")),
        9..=16 => Ok(format_ident!("i16")),
        17..=32 => Ok(format_ident!("i32")),
        _ => Err(Error::new_spanned(
            literal,
            "the bit bound of an enumeration is 1 to 32",
        )),
    }
}

fn default_literal(data: &DataEnum) -> syn::Result<Option<&Ident>> {
    let mut default = None;
    for variant in &data.variants {
        let attributes = VariantAttributes::parse(&variant.attrs)?;
        if !attributes.cases.is_empty() {
            return Err(Error::new_spanned(
                variant,
                "write the value of an enumeration's literal as `Name = value`",
            ));
        }
        if attributes.default && default.replace(&variant.ident).is_some() {
            return Err(Error::new_spanned(
                variant,
                "another variant is the default",
            ));
        }
    }
    Ok(default)
}
