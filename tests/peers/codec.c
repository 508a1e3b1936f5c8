/* What Cyclone DDS makes of serialized samples. A request, on standard input, is a type's number, the version of XCDR, 1
   where it is big endian, and what is wanted, an octet each; the size of the sample in 32 bits; the sample. The answer,
   on standard output, is a size and so many bytes; the size is -1 where the sample is none. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dds/dds.h"
#include "dds/ddsi/ddsi_cdrstream.h"
#include "Codec.h"

enum wanted { SAMPLE, KEY, BIG_ENDIAN_KEY };

static const dds_topic_descriptor_t *const types[] = {
  &codec_Plain_desc, &codec_Extensible_desc, &codec_Changing_desc, &codec_Located_desc, &codec_Named_desc,
};

static struct ddsi_sertype_default_desc describe (const dds_topic_descriptor_t *type)
{
  struct ddsi_sertype_default_desc desc = { 0 };
  desc.size = type->m_size;
  desc.align = type->m_align;
  desc.flagset = type->m_flagset;
  desc.keys.nkeys = type->m_nkeys;
  desc.keys.keys = calloc (type->m_nkeys + 1, sizeof (*desc.keys.keys));
  for (uint32_t i = 0; i < type->m_nkeys; i++)
  {
    desc.keys.keys[i].ops_offs = type->m_keys[i].m_offset;
    desc.keys.keys[i].idx = type->m_keys[i].m_idx;
  }
  desc.ops.nops = dds_stream_countops (type->m_ops, type->m_nkeys, type->m_keys);
  desc.ops.ops = (uint32_t *) type->m_ops;
  return desc;
}

static void answer (const void *bytes, uint32_t size)
{
  fwrite (&size, sizeof (size), 1, stdout);
  if (bytes != NULL)
    fwrite (bytes, 1, size, stdout);
  fflush (stdout);
}

static void convert (const unsigned char request[4], unsigned char *data, uint32_t size)
{
  const uint32_t version = request[1];
  const bool big_endian = request[2];
  struct ddsi_sertype_default type = { 0 };
  type.type = describe (types[request[0]]);
  uint32_t used;
  if (!dds_stream_normalize (data, size, big_endian, version, &type, false, &used))
  {
    answer (NULL, UINT32_MAX);
    free (type.type.keys.keys);
    return;
  }
  void *sample = calloc (1, type.type.size);
  dds_istream_t in;
  dds_istream_init (&in, used, data, version);
  dds_stream_read_sample (&in, sample, &type);
  dds_ostream_t out;
  dds_ostream_init (&out, 0, version);
  if (request[3] == KEY)
    dds_stream_write_key (&out, sample, &type);
  else if (request[3] == BIG_ENDIAN_KEY)
    dds_stream_write_keyBE ((dds_ostreamBE_t *) &out, sample, &type);
  else if (big_endian)
    (void) dds_stream_write_sampleBE ((dds_ostreamBE_t *) &out, sample, &type);
  else
    (void) dds_stream_write_sampleLE ((dds_ostreamLE_t *) &out, sample, &type);
  answer (out.m_buffer, out.m_index);
  dds_ostream_fini (&out);
  dds_stream_free_sample (sample, type.type.ops.ops);
  free (sample);
  free (type.type.keys.keys);
}

int main (void)
{
  unsigned char request[4];
  uint32_t size;
  while (fread (request, 1, 4, stdin) == 4 && fread (&size, sizeof (size), 1, stdin) == 1)
  {
    unsigned char *data = malloc (size + 1);
    if (fread (data, 1, size, stdin) != size)
      return 1;
    convert (request, data, size);
    free (data);
  }
  return 0;
}
