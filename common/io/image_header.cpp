// SPDX-License-Identifier: Apache-2.0
#include "common/io/image_header.h"

#include <algorithm>
#include <array>
#include <optional>

#include "common/io/orientation.h"

namespace cairn {
namespace {

using Bytes = std::span<const uint8_t>;

bool starts_with(Bytes bytes, Bytes prefix) {
  return bytes.size() >= prefix.size() && std::equal(prefix.begin(), prefix.end(), bytes.begin());
}
uint32_t big_endian_16(Bytes bytes, size_t at) {
  return uint32_t{bytes[at]} << 8 | bytes[at + 1];
}
uint32_t big_endian_32(Bytes bytes, size_t at) {
  return big_endian_16(bytes, at) << 16 | big_endian_16(bytes, at + 2);
}

tl::unexpected<Error> cut_short() {
  return fail(ErrorCode::kDamaged, "the file ends within its header");
}

tl::unexpected<Error> malformed(const char* what) {
  return fail(ErrorCode::kDamaged, what);
}

struct PngChunks {
  int orientation = kUpright;
  bool complete = false;  ///< each is all there, up to IEND
};

/// Walks the chunks (PNG specification, 5.3): length (4), type (4), data, checksum (4). A decoder takes
/// memory for the length that a chunk claims, so none may claim more than there is. eXIf may lie anywhere
/// between the first and the last (11.3).
PngChunks walk_chunks(Bytes bytes) {
  constexpr size_t kSignature = 8;
  constexpr size_t kAroundData = 12;
  constexpr std::array<uint8_t, 4> kExif = {'e', 'X', 'I', 'f'};
  constexpr std::array<uint8_t, 4> kIend = {'I', 'E', 'N', 'D'};
  PngChunks chunks;
  for (Bytes rest = bytes.subspan(kSignature); rest.size() >= kAroundData;) {
    const size_t length = big_endian_32(rest, 0);
    if (length > rest.size() - kAroundData) break;
    if (starts_with(rest.subspan(4), kExif)) chunks.orientation = exif_orientation(rest.subspan(8, length));
    chunks.complete = starts_with(rest.subspan(4), kIend);
    if (chunks.complete) break;
    rest = rest.subspan(kAroundData + length);
  }
  return chunks;
}

/// Signature (8), length (4), "IHDR", width, height (PNG specification, 11.2.1). A decoder passes over chunks
/// in front of IHDR: their bytes must not pass for the size.
Result<ImageHeader> read_png(Bytes bytes) {
  constexpr std::array<uint8_t, 8> kIhdr = {0, 0, 0, 13, 'I', 'H', 'D', 'R'};
  if (bytes.size() < 24) return cut_short();
  if (!starts_with(bytes.subspan(8), kIhdr)) return malformed("a PNG that does not begin with its header");
  const PngChunks chunks = walk_chunks(bytes);
  const int bits = bytes.size() > 24 ? bytes[24] : 8;
  return ImageHeader{ImageFormat::kPng,  big_endian_32(bytes, 16), big_endian_32(bytes, 20), bits,
                     chunks.orientation, chunks.complete};
}

/// The orientation in a JPEG's marker segment APP1, which is: marker and length, "Exif", two zeros, and the
/// TIFF structure. Nothing for another segment.
std::optional<int> jpeg_orientation(Bytes segment) {
  constexpr uint8_t kApp1 = 0xE1;
  constexpr std::array<uint8_t, 6> kExif = {'E', 'x', 'i', 'f', 0, 0};
  const size_t length = 2 + size_t{big_endian_16(segment, 2)};
  if (segment[1] != kApp1 || length > segment.size() || !starts_with(segment.subspan(4), kExif))
    return std::nullopt;
  return exif_orientation(segment.first(length).subspan(std::min<size_t>(length, 10)));
}

bool is_start_of_frame(uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

/// Walks the marker segments (ITU T.81, B.1). Thumbnails lie inside segments, so they are stepped over by
/// their length. A decoder takes the size of the first frame, so that a second one is none of this world; and
/// each scan, which may have a few bytes only, costs it a walk over all pixels.
Result<ImageHeader> read_jpeg(Bytes bytes) {
  constexpr int kMostScans = 100;  // progressive images have some ten
  constexpr uint8_t kStartOfScan = 0xDA;
  constexpr uint8_t kEndOfImage = 0xD9;
  std::optional<ImageHeader> header;
  std::optional<int> orientation;
  bool in_scan = false;
  int scans = 0;
  for (size_t at = 2; at + 1 < bytes.size();) {
    if (in_scan && bytes[at] != 0xFF) {
      at = static_cast<size_t>(std::find(bytes.begin() + static_cast<ptrdiff_t>(at), bytes.end(), 0xFF) -
                               bytes.begin());
      continue;
    }
    if (bytes[at] != 0xFF) break;
    const uint8_t marker = bytes[at + 1];
    if (marker == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    if (marker == kEndOfImage) {
      if (!header) break;
      header->complete = true;
      header->orientation = orientation.value_or(kUpright);
      return *header;
    }
    if (marker == 0x00 || marker == 0x01 ||
        (marker >= 0xD0 && marker <= 0xD7)) {  // stuffed byte, TEM, restarts
      at += 2;
      continue;
    }
    if (at + 4 > bytes.size()) break;
    if (is_start_of_frame(marker)) {
      if (at + 9 > bytes.size()) break;
      if (header) return malformed("a JPEG of two frames");
      header = ImageHeader{ImageFormat::kJpeg,
                           big_endian_16(bytes, at + 7),
                           big_endian_16(bytes, at + 5),
                           bytes[at + 4],
                           kUpright,
                           false};
    }
    if (!orientation) orientation = jpeg_orientation(bytes.subspan(at));
    in_scan = marker == kStartOfScan;
    if (in_scan && ++scans > kMostScans) return malformed("a JPEG of more than 100 scans");
    at += 2 + std::max<size_t>(2, big_endian_16(bytes, at + 2));
  }
  if (!header) return cut_short();
  return *header;
}

bool is_blank(uint8_t byte) {
  return byte == ' ' || (byte >= '\t' && byte <= '\r');
}

/// Behind blanks and '#' comments, each up to the end of its line.
size_t skip_blanks(Bytes bytes, size_t at) {
  while (at < bytes.size() && (is_blank(bytes[at]) || bytes[at] == '#')) {
    if (bytes[at] == '#') {
      while (at < bytes.size() && bytes[at] != '\n' && bytes[at] != '\r') ++at;
    } else {
      ++at;
    }
  }
  return at;
}

/// "P2".."P6", then width, height and the largest value in decimal (netpbm), a blank behind each: a decoder
/// passes over the byte that follows a number, whatever it is.
Result<ImageHeader> read_pnm(Bytes bytes) {
  constexpr const char* kNoNumbers = "a PGM or PPM whose header is not three numbers";
  std::array<int64_t, 3> numbers{};
  size_t at = 2;
  if (!is_blank(bytes[at])) return malformed(kNoNumbers);
  for (auto& number : numbers) {
    at = skip_blanks(bytes, at);
    const size_t begin = at;
    for (; at < bytes.size() && bytes[at] >= '0' && bytes[at] <= '9'; ++at) {
      number = std::min<int64_t>(number * 10 + (bytes[at] - '0'), int64_t{1} << 32);
    }
    if (at == bytes.size()) return cut_short();
    if (at == begin || !is_blank(bytes[at])) return malformed(kNoNumbers);
  }
  return ImageHeader{ImageFormat::kPnm, numbers[0], numbers[1], numbers[2] > 255 ? 16 : 8, kUpright, true};
}

}  // namespace

Result<ImageHeader> read_image_header(Bytes bytes) {
  constexpr std::array<uint8_t, 8> kPngSignature = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  constexpr std::array<uint8_t, 2> kJpegSignature = {0xFF, 0xD8};
  if (starts_with(bytes, kPngSignature)) return read_png(bytes);
  if (starts_with(bytes, kJpegSignature)) return read_jpeg(bytes);
  if (bytes.size() >= 3 && bytes[0] == 'P' && bytes[1] >= '2' && bytes[1] <= '6' && bytes[1] != '4') {
    return read_pnm(bytes);
  }
  return fail(ErrorCode::kDamaged, "not an image (PNG, JPEG and PGM/PPM are read)");
}

}  // namespace cairn
