// SPDX-License-Identifier: Apache-2.0
#include "server/admin/admin_client.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <random>
#include <thread>
#include <utility>

#include "common/io/json_text.h"
#include "common/wire/network_path.h"
#include "common/wire/partition.h"
#include "server/admin/listing.h"
#include "server/admin/own_name.h"

namespace cairn {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;

constexpr seconds kServerPatience{5};
constexpr milliseconds kResend{1000};
constexpr seconds kAnswerPatience{120};  ///< a large map takes the server a while

ErrorCode code_of(uint8_t result) {
  for (const ErrorCode code :
       {ErrorCode::kUsage, ErrorCode::kConfiguration, ErrorCode::kRefused, ErrorCode::kDamaged}) {
    if (exit_code(code) == result) return code;
  }
  return ErrorCode::kInternal;
}

tl::unexpected<Error> gone() {
  return fail(ErrorCode::kNoServer, "the server does not answer any more");
}

/// Appends the items of a list on a page to `all`. Returns how many there were.
size_t append(const json& page, const char* list, json* all) {
  const json items = page.value(list, json::array());
  all->insert(all->end(), items.begin(), items.end());
  return items.size();
}

}  // namespace

Result<AdminClient> AdminClient::connect(const AdminClientOptions& options) {
  const auto joining = joining_options(options, options.server);
  if (!joining) return tl::unexpected(joining.error());
  auto name = operator_name(options.security);
  if (!name) return tl::unexpected(name.error());
  auto participant = wire::Participant::create(*joining);
  if (!participant) return tl::unexpected(participant.error());
  const std::string partition = wire::operator_partition(*name);
  auto requests = wire::Writer<wire::AdminRequest>::create(*participant, partition);
  if (!requests) return tl::unexpected(requests.error());
  auto replies = wire::Reader<wire::AdminReply>::create(*participant, partition);
  if (!replies) return tl::unexpected(replies.error());
  auto waiter = wire::Waiter::create(*participant);
  if (!waiter) return tl::unexpected(waiter.error());
  if (Status attached = waiter->attach({*replies}); !attached) return tl::unexpected(attached.error());
  const auto deadline = steady_clock::now() + kServerPatience;
  while (requests->matched() == 0) {
    if (steady_clock::now() > deadline) {
      return fail(
          ErrorCode::kNoServer,
          "no server answers at " + options.server + ", domain " + std::to_string(options.domain) +
              ", asked " + wire::way_to(options.server, participant->path()) +
              "; is cairn-server running there, for this network (its --profile "
              "and --listen)? --listen here takes another interface" +
              (options.security.empty()
                   ? "; a secured site answers only who shows the keys of an operator, with --security"
                   : "; are the keys of --security of its site, and neither they nor the server's "
                     "revoked (`cairnctl keys list`)?"));
    }
    std::this_thread::sleep_for(milliseconds(5));
  }
  return AdminClient(*std::move(name), std::move(*participant), std::move(*requests), std::move(*replies),
                     std::move(*waiter));
}

AdminClient::AdminClient(std::string name, wire::Participant participant,
                         wire::Writer<wire::AdminRequest> requests, wire::Reader<wire::AdminReply> replies,
                         wire::Waiter waiter)
    : name_(std::move(name)),
      participant_(std::move(participant)),
      requests_(std::move(requests)),
      replies_(std::move(replies)),
      waiter_(std::move(waiter)) {
  std::random_device device;
  session_ = {uint64_t{device()} << 32 | device() | 1};
}

Result<AdminClient::Answer> AdminClient::ask(const json& request, std::vector<uint8_t> data) {
  wire::AdminRequest message{
      client_id_from_name(name_), {session_, ++seq_}, json_ascii(request), std::move(data)};
  const auto deadline = steady_clock::now() + kAnswerPatience;
  auto resend = steady_clock::now();
  while (steady_clock::now() < deadline) {
    if (stop_requested_()) return fail(ErrorCode::kIo, "interrupted");
    const auto now = steady_clock::now();
    if (now >= resend) {
      if (requests_.matched() == 0) return gone();
      if (Status written = requests_.write(message); !written) return tl::unexpected(written.error());
      resend = now + kResend;
    }
    (void)waiter_.wait(std::chrono::ceil<milliseconds>(resend - now));
    for (auto& sample : replies_.take()) {
      if (!sample.message || sample.message->command != message.command) continue;
      wire::AdminReply& reply = *sample.message;
      if (reply.result != 0) return fail(code_of(reply.result), std::move(reply.text));
      Answer answer{json::parse(reply.text, nullptr, false), std::move(reply.data)};
      if (!answer.content.is_object())
        return fail(ErrorCode::kDamaged, "the server's answer is not understood; is it of another version?");
      return answer;
    }
  }
  return gone();
}

Result<json> AdminClient::maps() {
  constexpr std::array kLists{"maps", "deleted", "damaged", "unloaded"};
  json all;
  for (const char* list : kLists) all[list] = json::array();
  while (true) {
    const std::string last = all["maps"].empty() ? "" : all["maps"].back().value("id", "");
    const auto page = ask({{"verb", "maps"},
                           {"after", last},
                           {"deleted_from", all["deleted"].size()},
                           {"damaged_from", all["damaged"].size()},
                           {"unloaded_from", all["unloaded"].size()}});
    if (!page) return tl::unexpected(page.error());
    size_t more = 0;
    for (const char* list : kLists) more += append(page->content, list, &all[list]);
    if (more == 0 || !page->content.value("more", false)) return all;
  }
}

Result<json> AdminClient::labels(const std::string& map) {
  json all = json::array();
  while (true) {
    const uint64_t last = all.empty() ? 0 : count_of(all.back(), "id");
    const auto page = ask({{"verb", "labels"}, {"map", map}, {"label", last}});
    if (!page) return tl::unexpected(page.error());
    if (append(page->content, "labels", &all) == 0 || !page->content.value("more", false)) return all;
  }
}

Result<json> AdminClient::download(const std::string& map, const std::filesystem::path& file,
                                   const Progress& progress) {
  return download(json{{"verb", "export"}, {"map", map}}, file, progress);
}

Result<json> AdminClient::download(const json& request, const std::filesystem::path& file,
                                   const Progress& progress) {
  const auto begun = ask(request);
  if (!begun) return tl::unexpected(begun.error());
  const std::string token = begun->content.value("token", "");
  const uint64_t size = count_of(begun->content, "bytes");
  if (Status done = fetch(token, size, file, progress); !done) return tl::unexpected(done.error());
  return begun->content;
}

Status AdminClient::fetch(const std::string& token, uint64_t size, const std::filesystem::path& file,
                          const Progress& progress) {
  errno = 0;  // a stream keeps it, and says nothing else
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  for (uint64_t offset = 0; out && offset < size;) {
    const auto piece = ask({{"verb", "export-read"}, {"token", token}, {"offset", offset}});
    if (!piece) return tl::unexpected(piece.error());
    if (piece->data.empty()) return fail(ErrorCode::kDamaged, "the archive ends too soon");
    errno = 0;
    out.write(reinterpret_cast<const char*>(piece->data.data()),
              static_cast<std::streamsize>(piece->data.size()));
    offset += piece->data.size();
    progress(offset, size);
  }
  out.close();
  if (out) return {};
  return fail(ErrorCode::kIo, file.string() + ": cannot be written: " + std::strerror(errno));
}

Result<json> AdminClient::upload(const std::filesystem::path& file, const Progress& progress) {
  const auto unreadable = [] {
    return fail(ErrorCode::kIo, std::string("cannot be read: ") + std::strerror(errno));
  };
  errno = 0;  // a stream keeps it, and says nothing else
  std::ifstream in(file, std::ios::binary);
  if (!in) return unreadable();
  std::error_code problem;
  const uint64_t size = std::filesystem::file_size(file, problem);
  if (problem) return fail(ErrorCode::kIo, "cannot be read: " + problem.message());
  const std::string token = "import-" + std::to_string(session_.value % 1'000'000'000'000);
  if (const auto begun = ask({{"verb", "import-begin"}, {"token", token}}); !begun)
    return tl::unexpected(begun.error());
  for (uint64_t offset = 0; offset < size;) {
    std::vector<uint8_t> piece(std::min<uint64_t>(wire::kMaxAdminData, size - offset));
    in.read(reinterpret_cast<char*>(piece.data()), static_cast<std::streamsize>(piece.size()));
    if (!in) return unreadable();
    const size_t bytes = piece.size();
    const auto written =
        ask({{"verb", "import-write"}, {"token", token}, {"offset", offset}}, std::move(piece));
    if (!written) return tl::unexpected(written.error());
    offset += bytes;
    progress(offset, size);
  }
  auto imported = ask({{"verb", "import"}, {"token", token}});
  if (!imported) return tl::unexpected(imported.error());
  return std::move(imported->content);
}

}  // namespace cairn
