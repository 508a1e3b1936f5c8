//! Typedefs: structs of one field without a name, encoded as that field is.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{DeriveInput, Field, Type};

use crate::attributes::{FieldAttributes, TypeAttributes};
use crate::description;

pub(crate) fn expand(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    field: &Field,
) -> syn::Result<TokenStream> {
    let cdr = crate::cdr();
    let ident = &input.ident;
    let type_name = attributes.type_name(ident);
    let FieldAttributes { bound, uint8, .. } = FieldAttributes::parse(&field.attrs)?;
    let ty = &field.ty;
    let generics = crate::bound_generics(&input.generics);
    let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
    let check = |value| {
        let bound = bound.as_ref()?;
        Some(quote!(#cdr::check_bound(#type_name, #bound, #value)?;))
    };
    let (check_own, check_read) = (check(quote!(&self.0)), check(quote!(&aliased)));
    let add_key_size = match &bound {
        Some(bound) => quote!(<#ty as #cdr::Bounded>::add_bounded_key_size(size, #bound)),
        None => quote!(<#ty as #cdr::CdrType>::add_key_size(size)),
    };
    let aliased = description::member_type(ty, bound.as_ref(), uint8);
    let definition = quote!(#cdr::Definition::Alias(#aliased));
    let describe = description::function(&type_name, Some(&definition));
    let same = same(ty);
    Ok(quote! {
        #[automatically_derived]
        impl #impl_generics #cdr::CdrType for #ident #type_generics #where_clause {
            #same

            fn encode(
                &self,
                encoder: &mut #cdr::Encoder<'_>,
            ) -> ::core::result::Result<(), #cdr::EncodeError> {
                #check_own
                #cdr::CdrType::encode(&self.0, encoder)
            }

            fn decode(
                decoder: &mut #cdr::Decoder<'_>,
            ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                let aliased: #ty = #cdr::CdrType::decode(decoder)?;
                #check_read
                Ok(Self(aliased))
            }

            fn add_key_size(size: &mut #cdr::KeySize) { #add_key_size }

            fn encode_flat(
                &self,
                encoder: &mut #cdr::Encoder<'_>,
            ) -> ::core::result::Result<(), #cdr::EncodeError> {
                #check_own
                #cdr::CdrType::encode_flat(&self.0, encoder)
            }

            fn decode_flat(
                &mut self,
                decoder: &mut #cdr::Decoder<'_>,
            ) -> ::core::result::Result<(), #cdr::DecodeError> {
                #cdr::CdrType::decode_flat(&mut self.0, decoder)?;
                #check_own
                Ok(())
            }

            #describe
        }
    })
}

/// What no bound makes different.
fn same(ty: &Type) -> TokenStream {
    let cdr = crate::cdr();
    quote! {
        const IS_PRIMITIVE: bool = <#ty as #cdr::CdrType>::IS_PRIMITIVE;
        const LEAF_IS_PRIMITIVE: bool = <#ty as #cdr::CdrType>::LEAF_IS_PRIMITIVE;
        const MIN_SIZE: usize = <#ty as #cdr::CdrType>::MIN_SIZE;
        const LENGTH_CODE: #cdr::LengthCode = <#ty as #cdr::CdrType>::LENGTH_CODE;

        fn default_value() -> Self { Self(<#ty as #cdr::CdrType>::default_value()) }

        fn value_at(
            &self,
            path: &[&::core::primitive::str],
        ) -> ::core::option::Option<#cdr::Value<'_>> {
            #cdr::CdrType::value_at(&self.0, path)
        }

        fn type_at(
            path: &[&::core::primitive::str],
        ) -> ::core::option::Option<#cdr::FieldType> {
            <#ty as #cdr::CdrType>::type_at(path)
        }
    }
}
