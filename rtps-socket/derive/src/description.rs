//! `CdrType::describe`: what the TypeObject says of the type.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{Expr, Type};

/// The function, for a type that `definition` defines; without one the type cannot be described.
pub(crate) fn function(type_name: &str, definition: Option<&TokenStream>) -> Option<TokenStream> {
    let cdr = crate::cdr();
    let definition = definition?;
    Some(quote! {
        fn describe(
            types: &mut #cdr::TypeBuilder,
        ) -> ::core::option::Option<#cdr::TypePair> {
            types.define(#type_name, |types| ::core::option::Option::Some(#definition))
        }
    })
}

/// The type of a member, where `types` is the builder.
pub(crate) fn member_type(ty: &Type, bound: Option<&Expr>, uint8: bool) -> TokenStream {
    let cdr = crate::cdr();
    let plain = match bound {
        Some(bound) => quote! {
            <#ty as #cdr::Bounded>::describe_bounded(
                types,
                ::core::convert::TryFrom::try_from(#bound).ok()?,
            )?
        },
        None => quote!(<<#ty as #cdr::Member>::Value as #cdr::CdrType>::describe(types)?),
    };
    match uint8 {
        true => quote!(#plain.uint8()),
        false => plain,
    }
}
