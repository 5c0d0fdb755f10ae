// SPDX-License-Identifier: Apache-2.0
#include "server/store/backup.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <sstream>

#include "common/map/ids.h"
#include "server/store/database_files.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

// POSIX ustar: blocks of 512 bytes, a header before each file, two blocks of zeros at the end.
constexpr size_t kBlock = 512;
constexpr size_t kPiece = size_t{1} << 20;
constexpr uint64_t kMostPartBytes = 077777777777;  ///< eleven octal digits
constexpr size_t kMostContentBytes = size_t{64} << 20;
constexpr const char* kContentName = "content.txt";
constexpr std::string_view kFirstLine = "cairn backup 1";

struct Header {
  std::array<char, 100> name;
  std::array<char, 8> mode, owner, group;
  std::array<char, 12> size, time;
  std::array<char, 8> checksum;
  char type;
  std::array<char, 100> link;
  std::array<char, 6> magic;
  std::array<char, 2> version;
  std::array<char, 32> owner_name, group_name;
  std::array<char, 8> major, minor;
  std::array<char, 155> prefix;
  std::array<char, 12> padding;
};
static_assert(sizeof(Header) == kBlock);

template <size_t Size>
void put_octal(std::array<char, Size>* field, uint64_t value) {
  const std::string digits = fmt::format("{:0{}o}", value, Size - 1);
  std::copy_n(digits.data(), std::min(digits.size(), Size - 1), field->data());
}

template <size_t Size>
void put_text(std::array<char, Size>* field, std::string_view text) {
  std::copy_n(text.data(), std::min(text.size(), Size), field->data());
}

uint64_t sum_of(Header header) {
  header.checksum.fill(' ');
  uint64_t sum = 0;
  for (const unsigned char byte : std::span(reinterpret_cast<const unsigned char*>(&header), kBlock))
    sum += byte;
  return sum;
}

Header make_header(const std::string& name, uint64_t bytes) {
  Header header{};
  put_text(&header.name, name);
  put_octal(&header.mode, 0640);
  put_octal(&header.owner, 0);
  put_octal(&header.group, 0);
  put_octal(&header.size, bytes);
  put_octal(&header.time, 0);
  header.type = '0';
  put_text(&header.magic, "ustar");
  put_text(&header.version, "00");
  header.checksum.fill(' ');
  const std::string sum = fmt::format("{:06o}", sum_of(header));
  std::copy(sum.begin(), sum.end(), header.checksum.begin());
  header.checksum[6] = '\0';
  return header;
}

uint64_t padding_after(uint64_t bytes) {
  return (kBlock - bytes % kBlock) % kBlock;
}

std::string text_of(const BackupContent& content) {
  std::string text =
      fmt::format("{}\nmade {}\nversion {}\n", kFirstLine, content.made.nanoseconds, content.version);
  for (const BackupPart& part : content.parts)
    text += fmt::format("{:08x} {} {}\n", part.checksum, part.bytes, part.name);
  return text + fmt::format("{:08x}\n", crc32_z(0, reinterpret_cast<const Bytef*>(text.data()), text.size()));
}

std::vector<std::string> names_of(const std::vector<BackupPart>& parts) {
  std::vector<std::string> names;
  std::ranges::transform(parts, std::back_inserter(names), &BackupPart::name);
  return names;
}

std::optional<BackupContent> parse(const std::string& text) {
  BackupContent content;
  const size_t last = text.size() < 2 ? std::string::npos : text.rfind('\n', text.size() - 2);
  if (last == std::string::npos) return std::nullopt;
  const auto sum = crc32_z(0, reinterpret_cast<const Bytef*>(text.data()), last + 1);
  if (text.substr(last + 1) != fmt::format("{:08x}\n", sum)) return std::nullopt;
  std::istringstream lines(text.substr(0, last + 1));
  std::string line, word;
  if (!std::getline(lines, line) || line != kFirstLine) return std::nullopt;
  lines >> word >> content.made.nanoseconds >> word >> content.version;
  BackupPart part;
  while (lines >> std::hex >> part.checksum >> std::dec >> part.bytes >> part.name)
    content.parts.push_back(part);
  return content;
}

/// Makes a file for owner and group only, whatever the umask of who unpacks it: it holds images and rights.
Status make_for_owner_and_group(const fs::path& path, std::ofstream* out) {
  std::error_code problem;
  const fs::path folder = path.parent_path();
  const bool is_new = fs::create_directories(folder, problem);
  constexpr fs::perms kFolder = fs::perms::owner_all | fs::perms::group_read | fs::perms::group_exec;
  if (!problem && is_new) fs::permissions(folder, kFolder, problem);
  if (problem) return io_failure(folder, "cannot be made: " + problem.message());
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0640);
  const bool is_made = descriptor >= 0 && ::fchmod(descriptor, 0640) == 0;
  const std::string why = std::strerror(errno);
  if (descriptor >= 0) ::close(descriptor);
  if (!is_made) return io_failure(path, "cannot be made: " + why);
  errno = 0;
  out->open(path, std::ios::binary | std::ios::trunc);
  return *out ? Status() : io_failure(path, std::string("cannot be written: ") + std::strerror(errno));
}

Status close_durably(std::ofstream* out, const fs::path& path) {
  errno = 0;
  out->close();
  const int descriptor = *out ? ::open(path.c_str(), O_RDONLY | O_CLOEXEC) : -1;
  const bool is_durable = descriptor >= 0 && ::fsync(descriptor) == 0;
  const std::string why = std::strerror(errno);
  if (descriptor >= 0) ::close(descriptor);
  return is_durable ? Status() : io_failure(path, "cannot be written: " + why);
}

/// Reads a backup from its beginning to its end.
class Reading {
 public:
  Reading(const fs::path& path, const std::optional<fs::path>& folder, const BackupProgress& progress)
      : path_(path), folder_(folder), progress_(progress), in_(path, std::ios::binary) {}

  Result<BackupContent> run() {
    std::error_code problem;
    size_ = fs::file_size(path_, problem);
    if (problem || !in_)
      return io_failure(path_, "cannot be read: " + (problem ? problem.message() : std::strerror(errno)));
    while (true) {
      const auto header = next_header();
      if (!header) return tl::unexpected(header.error());
      if (header->first == kContentName) return end(header->second);
      if (Status read = read_part(header->first, header->second); !read) return tl::unexpected(read.error());
    }
  }

 private:
  [[nodiscard]] tl::unexpected<Error> damaged(const std::string& what) const {
    return fail(ErrorCode::kDamaged, path_.string() + ": " + what + "; take another backup");
  }
  bool get(char* bytes, size_t count) {
    in_.read(bytes, static_cast<std::streamsize>(count));
    return static_cast<size_t>(in_.gcount()) == count;
  }

  Result<std::pair<std::string, uint64_t>> next_header() {
    Header header{};
    if (!get(reinterpret_cast<char*>(&header), kBlock))
      return damaged(parts_.empty() ? "no backup of cairnctl" : "it is cut off");
    const std::string name(header.name.data(), strnlen(header.name.data(), header.name.size()));
    uint64_t bytes = 0;
    std::from_chars(header.size.data(), header.size.data() + header.size.size() - 1, bytes, 8);
    const Header expected = make_header(name, bytes);
    if (std::memcmp(&expected, &header, kBlock) == 0) return std::pair(name, bytes);
    if (parts_.empty()) return damaged("no backup of cairnctl");
    return damaged("it is altered behind " + parts_.back().name);
  }

  Status read_part(const std::string& name, uint64_t bytes) {
    if (!is_backup_part(name)) return damaged("it holds '" + name + "', which is no file of a store");
    if (std::ranges::any_of(parts_, [&](const BackupPart& part) { return part.name == name; }))
      return damaged("it holds " + name + " twice");
    std::ofstream out;
    if (folder_) {
      if (Status made = make_for_owner_and_group(*folder_ / name, &out); !made) return made;
    }
    std::vector<char> piece(std::min<uint64_t>(kPiece, bytes));
    uLong sum = crc32(0, nullptr, 0);
    for (uint64_t left = bytes; left > 0;) {
      const auto count = static_cast<size_t>(std::min<uint64_t>(piece.size(), left));
      if (!get(piece.data(), count)) return damaged("it is cut off in " + name);
      sum = crc32_z(sum, reinterpret_cast<const Bytef*>(piece.data()), count);
      left -= count;
      errno = 0;
      if (folder_ && !out.write(piece.data(), static_cast<std::streamsize>(count)))
        return io_failure(*folder_ / name, std::string("cannot be written: ") + std::strerror(errno));
      if (progress_) progress_(static_cast<uint64_t>(in_.tellg()), size_);
    }
    if (Status padded = skip_padding(bytes, name); !padded) return padded;
    if (folder_) {
      if (Status closed = close_durably(&out, *folder_ / name); !closed) return closed;
    }
    parts_.push_back({name, bytes, static_cast<uint32_t>(sum)});
    return {};
  }

  Status skip_padding(uint64_t bytes, const std::string& name) {
    std::array<char, kBlock> padding{};
    const uint64_t count = padding_after(bytes);
    if (!get(padding.data(), count)) return damaged("it is cut off in " + name);
    if (std::ranges::any_of(padding, [](char byte) { return byte != 0; }))
      return damaged("it is altered behind " + name);
    return {};
  }

  /// Reads the list of contents and checks that what there is is what was written, to the last byte.
  Result<BackupContent> end(uint64_t bytes) {
    if (bytes > kMostContentBytes) return damaged("its list of contents is altered");
    std::string text(bytes, '\0');
    if (!get(text.data(), bytes)) return damaged("it is cut off in its list of contents");
    if (Status padded = skip_padding(bytes, kContentName); !padded) return tl::unexpected(padded.error());
    std::array<char, 2 * kBlock> zeros{};
    if (!get(zeros.data(), zeros.size())) return damaged("it is cut off at its end");
    const bool has_more = in_.peek() != std::ifstream::traits_type::eof();
    if (has_more || std::ranges::any_of(zeros, [](char byte) { return byte != 0; }))
      return damaged("something follows its end");
    const auto content = parse(text);
    if (!content) return damaged("its list of contents is altered");
    for (const BackupPart& part : content->parts) {
      const auto found = std::ranges::find(parts_, part.name, &BackupPart::name);
      if (found == parts_.end()) return damaged(part.name + " is missing in it");
      if (found->bytes != part.bytes || found->checksum != part.checksum)
        return damaged(part.name + " in it is altered");
    }
    if (content->parts.size() != parts_.size()) return damaged("it holds what its list of contents does not");
    if (const Status all = check_is_all(names_of(parts_)); !all) return damaged(all.error().message);
    return std::move(*content);
  }

  const fs::path& path_;
  const std::optional<fs::path>& folder_;
  const BackupProgress& progress_;
  std::ifstream in_;
  uint64_t size_ = 0;
  std::vector<BackupPart> parts_;
};

}  // namespace

bool is_backup_part(const std::string& name) {
  if (name == "site.db" || name == "catalogue.db") return true;
  for (const std::string_view folder : {"maps/", "deleted/"}) {
    constexpr std::string_view kSuffix = ".cairnmap";
    if (!name.starts_with(folder) || !name.ends_with(kSuffix)) continue;
    const std::string id = name.substr(folder.size(), name.size() - folder.size() - kSuffix.size());
    const auto bytes = from_hex(id);
    if (bytes && to_hex(*bytes) == id) return true;
  }
  return false;
}

Status check_is_all(std::span<const std::string> parts) {
  for (const char* needed : {"catalogue.db", "site.db"}) {
    if (std::ranges::find(parts, needed) == parts.end())
      return fail(ErrorCode::kDamaged, std::string(needed) + " is missing");
  }
  return {};
}

Result<BackupWriter> BackupWriter::create(const fs::path& path) {
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (descriptor < 0 && errno == EEXIST)
    return fail(ErrorCode::kRefused,
                path.string() + ": is there already, and a backup replaces nothing; choose another name");
  if (descriptor < 0) return io_failure(path, std::string("cannot be made: ") + std::strerror(errno));
  ::close(descriptor);
  BackupWriter writer(path);
  writer.out_.open(path, std::ios::binary | std::ios::trunc);
  if (!writer.out_) return io_failure(path, std::string("cannot be written: ") + std::strerror(errno));
  return writer;
}

Status BackupWriter::put(const char* bytes, size_t count) {
  errno = 0;  // a stream keeps it, and says nothing else
  if (out_.write(bytes, static_cast<std::streamsize>(count))) return {};
  return io_failure(path_, std::string("cannot be written: ") + std::strerror(errno));
}

Status BackupWriter::put_header(const std::string& name, uint64_t bytes) {
  const Header header = make_header(name, bytes);
  return put(reinterpret_cast<const char*>(&header), kBlock);
}

Status BackupWriter::pad(uint64_t bytes) {
  const std::array<char, kBlock> zeros{};
  return put(zeros.data(), padding_after(bytes));
}

Status BackupWriter::add(const std::string& name, const fs::path& file) {
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  std::error_code problem;
  const uint64_t bytes = fs::file_size(file, problem);
  if (!in || problem) return io_failure(file, std::string("cannot be read: ") + std::strerror(errno));
  if (bytes > kMostPartBytes) return io_failure(file, "is larger than 8 GB, which a backup cannot hold");
  Status done = put_header(name, bytes);
  std::vector<char> piece(kPiece);
  uLong sum = crc32(0, nullptr, 0);
  for (uint64_t left = bytes; done && left > 0;) {
    const auto count = static_cast<size_t>(std::min<uint64_t>(piece.size(), left));
    if (!in.read(piece.data(), static_cast<std::streamsize>(count)))
      return io_failure(file, std::string("cannot be read: ") + std::strerror(errno));
    sum = crc32_z(sum, reinterpret_cast<const Bytef*>(piece.data()), count);
    done = put(piece.data(), count);
    left -= count;
  }
  if (done) done = pad(bytes);
  if (done) content_.parts.push_back({name, bytes, static_cast<uint32_t>(sum)});
  return done;
}

Status BackupWriter::finish(Timestamp made, const std::string& version) {
  if (Status all = check_is_all(names_of(content_.parts)); !all) return all;
  content_.made = made;
  content_.version = version.empty() ? "-" : version;
  const std::string text = text_of(content_);
  const std::array<char, 2 * kBlock> zeros{};
  Status done = put_header(kContentName, text.size());
  if (done) done = put(text.data(), text.size());
  if (done) done = pad(text.size());
  if (done) done = put(zeros.data(), zeros.size());
  if (!done) return done;
  return close_durably(&out_, path_);
}

Result<BackupContent> read_backup(const fs::path& path, const std::optional<fs::path>& folder,
                                  const BackupProgress& progress) {
  return Reading(path, folder, progress).run();
}

}  // namespace cairn
