//! The access that content filters have to members, by name.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{DeriveInput, Ident, Type};

use crate::discriminator::{Discriminator, Label};

/// A struct's member.
pub(crate) struct StructField<'a> {
    pub(crate) ident: &'a Ident,
    /// In IDL, as in all others.
    pub(crate) name: &'a str,
    pub(crate) ty: &'a Type,
    /// Whether a serialized key holds it.
    pub(crate) is_key: TokenStream,
}

/// `CdrType::value_at` and `type_at` of a struct; the members of `base` are its own.
pub(crate) fn of_struct<'a>(
    base: Option<StructField<'a>>,
    fields: impl Iterator<Item = StructField<'a>>,
) -> TokenStream {
    let cdr = crate::cdr();
    let (values, types): (Vec<_>, Vec<_>) = fields
        .map(|field| {
            let StructField {
                ident,
                name,
                ty,
                is_key,
            } = field;
            let value = quote! {
                [#name, path @ ..] => {
                    #cdr::CdrType::value_at(#cdr::Member::value(&self.#ident)?, path)
                }
            };
            (
                value,
                quote!([#name, path @ ..] => #cdr::member_type::<#ty>(path, #is_key),),
            )
        })
        .unzip();
    let (inherited_values, inherited_types) = base
        .map(
            |StructField {
                 ident, ty, is_key, ..
             }| {
                (
                    quote!(path => #cdr::CdrType::value_at(&self.#ident, path),),
                    quote!(path => #cdr::member_type::<#ty>(path, #is_key),),
                )
            },
        )
        .unzip();
    accessors(
        &quote!(#(#values)* #inherited_values),
        &quote!(#(#types)* #inherited_types),
    )
}

/// `CdrType::value_at` and `type_at` of an enumeration with these literals and their names.
pub(crate) fn of_enumeration(ident: &Ident, literals: &[&Ident], names: &[String]) -> TokenStream {
    let cdr = crate::cdr();
    accessors(
        &quote! {
            [] => ::core::option::Option::Some(#cdr::Value::Int(match self {
                #(Self::#literals => Self::#literals as i64,)*
            })),
        },
        &quote! {
            [] => {
                const LITERALS: &[(&::core::primitive::str, i64)] =
                    &[#((#names, #ident::#literals as i64)),*];
                ::core::option::Option::Some(#cdr::FieldType {
                    kind: #cdr::Kind::Enum(LITERALS),
                    is_key: true,
                })
            }
        },
    )
}

/// A union's variant.
pub(crate) struct UnionField<'a> {
    pub(crate) ident: &'a Ident,
    pub(crate) name: &'a str,
    pub(crate) ty: Option<&'a Type>,
    /// The discriminator as it is written.
    pub(crate) label: Option<&'a Label>,
}

/// `CdrType::value_at` and `type_at` of a union; its discriminator is `_d`, as in the language mappings, or
/// `discriminator`, as in XTypes 7.5.
pub(crate) fn of_union(discriminator: &Discriminator, fields: &[UnionField<'_>]) -> TokenStream {
    let cdr = crate::cdr();
    let labels = fields.iter().map(|field| {
        let UnionField { ident, label, .. } = field;
        let member = field.ty.map(|_| quote!((_)));
        quote!(Self::#ident #member => &#label,)
    });
    let others = (fields.len() > 1).then(|| quote!(_ => ::core::option::Option::None,));
    let (mut values, mut types) = (Vec::new(), Vec::new());
    for UnionField {
        ident, name, ty, ..
    } in fields
    {
        let Some(ty) = ty else { continue };
        values.push(quote! {
            [#name, path @ ..] => match self {
                Self::#ident(value) => #cdr::CdrType::value_at(value, path),
                #others
            },
        });
        types.push(quote!([#name, path @ ..] => <#ty as #cdr::CdrType>::type_at(path),));
    }
    accessors(
        &quote! {
            ["_d" | "discriminator"] => {
                let label: &'static #discriminator = match self { #(#labels)* };
                #cdr::CdrType::value_at(label, &[])
            }
            #(#values)*
        },
        &quote! {
            ["_d" | "discriminator"] => <#discriminator as #cdr::CdrType>::type_at(&[]),
            #(#types)*
        },
    )
}

/// `Fields` of a topic's type.
pub(crate) fn fields_impl(input: &DeriveInput) -> TokenStream {
    let cdr = crate::cdr();
    let ident = &input.ident;
    let generics = crate::bound_generics(&input.generics);
    let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
    quote! {
        #[automatically_derived]
        impl #impl_generics #cdr::Fields for #ident #type_generics #where_clause {
            fn field(
                &self,
                path: &[&::core::primitive::str],
            ) -> ::core::option::Option<#cdr::Value<'_>> {
                #cdr::CdrType::value_at(self, path)
            }
        }
    }
}

/// The two functions, from the arms of a match of the path.
fn accessors(values: &TokenStream, types: &TokenStream) -> TokenStream {
    let cdr = crate::cdr();
    let unreachable = "all other paths may be those of inherited members";
    quote! {
        #[allow(unreachable_patterns, reason = #unreachable)]
        fn value_at(
            &self,
            path: &[&::core::primitive::str],
        ) -> ::core::option::Option<#cdr::Value<'_>> {
            match path {
                #values
                _ => ::core::option::Option::None,
            }
        }

        #[allow(unreachable_patterns, reason = #unreachable)]
        fn type_at(
            path: &[&::core::primitive::str],
        ) -> ::core::option::Option<#cdr::FieldType> {
            match path {
                #types
                _ => ::core::option::Option::None,
            }
        }
    }
}
