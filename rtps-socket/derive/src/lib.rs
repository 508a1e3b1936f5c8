//! The derive macro of the RTPS-socket API: `#[derive(DdsType)]`.
//!
//! It implements `rtps_socket::cdr::CdrType`, and for structs and unions `DdsType`, by calls into
//! that module; the encoding rules themselves are written there, not here.

mod alias;
mod attributes;
mod bits;
mod description;
mod discriminator;
mod enumeration;
mod fields;
mod member;
mod structure;
mod union;

use proc_macro::TokenStream;
use quote::{ToTokens, quote};
use syn::{Data, DeriveInput, Error, Fields, Generics, parse_macro_input, parse_quote};

use attributes::TypeAttributes;

/// Implements the encoding of a struct, an enumeration or a union for DDS.
///
/// ```text
/// #[derive(DdsType)]
/// struct ShapeType {
///     #[dds(key, bound = 128)]
///     color: String,
///     x: i32,
///     y: i32,
///     shapesize: i32,
///     additional_payload_size: Vec<u8>,
/// }
/// ```
///
/// An enum whose variants have no data is an IDL enumeration; one with data is an IDL union. A struct of one field
/// without a name is a typedef.
///
/// On the type: `final`, `appendable` (the default) or `mutable`; `type_name = "module::Name"`;
/// enumerations: `bit_bound = 8` (or 16, 32); unions: `discriminator = "u8"` (default `i32`; an
/// integer, `bool`, `char` or an enumeration); structs: `autoid = "hash"`;
/// `bitmask` (of `bool`s, with `bit_bound = 8`, 16, 32 or 64) or `bitset` (of `bool`s and integers with `bits = 3` each);
/// `by_name`: endpoints announce no TypeInformation, and are matched by the type's name alone.
///
/// On a struct's field: `key`; `id = 7` (default: the preceding one plus 1, from 0), or `hashid`, or
/// `hashid = "name"`; `bound = 128`
/// for strings, sequences and maps; `default = expression` for values that the sender does not
/// know; `try_construct = "use_default"` or `"trim"` for values that the type does not have; `must_understand`;
/// `external`; `non_serialized`; `uint8` where `u8` is IDL's `uint8` and not `octet`; `name = "x"` where
/// IDL has another name; `base` on the first one inherits its type's members. `Option` makes a member optional.
/// Fields of bitmasks and bitsets have `position = 3` unless they follow the preceding one.
///
/// On a variant: `case = 3`, `true`, `'a'` or `Color::Red` (repeatable; for integers
/// by default the preceding one plus 1, from 0) in unions;
/// `default` for what no other variant stands for; `name` and `uint8` as on fields.
#[proc_macro_derive(DdsType, attributes(dds))]
pub fn derive_dds_type(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    expand(&input)
        .unwrap_or_else(|error| error.to_compile_error())
        .into()
}

fn expand(input: &DeriveInput) -> syn::Result<proc_macro2::TokenStream> {
    let attributes = TypeAttributes::parse(&input.attrs)?;
    match &input.data {
        Data::Struct(data) => match &data.fields {
            Fields::Named(fields) => match attributes.bits {
                Some(kind) => bits::expand(input, &attributes, kind, fields),
                None => structure::expand(input, &attributes, fields),
            },
            Fields::Unnamed(fields) if fields.unnamed.len() == 1 => {
                alias::expand(input, &attributes, &fields.unnamed[0])
            }
            Fields::Unnamed(_) | Fields::Unit => Err(Error::new_spanned(
                &input.ident,
                "members of a DDS struct have names: use `struct Name { member: Type }`; one without \
                 is an alias",
            )),
        },
        Data::Enum(data) if data.variants.is_empty() => Err(Error::new_spanned(
            &input.ident,
            "a DDS enumeration or union has at least one variant",
        )),
        Data::Enum(data) => {
            let plain = data
                .variants
                .iter()
                .all(|variant| variant.fields.is_empty());
            if plain && attributes.discriminator.is_none() {
                enumeration::expand(input, &attributes, data)
            } else {
                union::expand(input, &attributes, data)
            }
        }
        Data::Union(_) => Err(Error::new_spanned(
            &input.ident,
            "derive `DdsType` for an enum with data: that is what an IDL union is here",
        )),
    }
}

/// Path of the module that generated code calls.
fn cdr() -> proc_macro2::TokenStream {
    quote!(::rtps_socket::cdr)
}

/// The type's generics, every type parameter bound by `CdrType`.
fn bound_generics(generics: &Generics) -> Generics {
    let mut generics = generics.clone();
    let cdr = cdr();
    for parameter in generics.type_params_mut() {
        parameter.bounds.push(parse_quote!(#cdr::CdrType));
    }
    generics
}

/// `impl DdsType` of a struct or union.
fn dds_type_impl(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    has_key: &proc_macro2::TokenStream,
) -> proc_macro2::TokenStream {
    let cdr = cdr();
    let ident = &input.ident;
    let generics = bound_generics(&input.generics);
    let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
    let type_name = attributes.type_name(ident);
    let extensibility = attributes.extensibility.to_token_stream();
    let fields = fields::fields_impl(input);
    let is_described = !attributes.by_name;
    quote! {
        #fields

        #[automatically_derived]
        impl #impl_generics #cdr::DdsType for #ident #type_generics #where_clause {
            const TYPE_NAME: &'static str = #type_name;
            const EXTENSIBILITY: #cdr::Extensibility = #extensibility;
            const HAS_KEY: bool = #has_key;
            const IS_DESCRIBED: bool = #is_described;
        }
    }
}
