// SPDX-License-Identifier: Apache-2.0
#include "server/admin/doctor.h"

#include <ifaddrs.h>
#include <net/if.h>
#include <sys/statvfs.h>
#include <sys/timex.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>
#include <vector>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "common/io/json_text.h"
#include "common/wire/network_path.h"
#include "server/admin/doctor_security.h"
#include "server/admin/listing.h"
#include "server/admin/own_name.h"

namespace cairn {
namespace {

using nlohmann::json;
using Grade = Finding::Grade;

constexpr uint64_t kWantedBuffer = 4'000'000;  ///< [bytes] as the network profiles ask for
constexpr uint64_t kFewBytes = 1'000'000'000;  ///< of free disk
constexpr double kFewShare = 0.05;
constexpr uint16_t kPortsOfDomain = 160;  ///< server, participants, rigs and wearers' cameras

constexpr const char* kFooter =
    "Exit codes: 0 nothing is in the way, 1 something is\n\n"
    "Examples:\n"
    "  cairnctl doctor                                     of this machine and the server on it\n"
    "  cairnctl --server cairn.local doctor                of a client's way to a server\n"
    "  cairnctl --security cairn-keys/enclaves/operator/ann doctor\n"
    "                                                      and of these keys, their authorities and "
    "crl.pem;\n"
    "                                                      with a client's the server is not asked\n"
    "  cairnctl doctor --data /var/lib/cairn/store --keys cairn-keys";

struct Words {
  std::string data;
  std::string keys;
};

std::string content_of(const char* path) {
  std::ifstream in(path);
  std::string text;
  std::getline(in, text);
  return text;
}

std::optional<uint64_t> number_in(const std::string& text) {
  uint64_t number = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), number);
  return problem == std::errc() ? std::optional(number) : std::nullopt;
}

/// Whether `port` is among "7000-8000,9000".
bool is_reserved(const std::string& reserved, uint64_t first, uint64_t last) {
  std::istringstream parts(reserved);
  for (std::string part; std::getline(parts, part, ',');) {
    const auto begin = number_in(part);
    const size_t dash = part.find('-');
    const auto end = dash == std::string::npos ? begin : number_in(part.substr(dash + 1));
    if (begin && end && *begin <= first && last <= *end) return true;
  }
  return false;
}

/// The way to the server, and whether the interface is there.
std::vector<Finding> look_at_network(const AdminClientOptions& connection) {
  const auto path = joining_options(connection, connection.server).and_then(wire::find_path);
  if (!path)
    return {{"interface", Grade::kProblem, path.error().message, "see to name, network and --listen"}};
  std::vector<Finding> findings{{"interface", Grade::kOk, wire::describe(*path), ""}};
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return findings;
  const std::unique_ptr<ifaddrs, decltype(&::freeifaddrs)> owner(all, &::freeifaddrs);
  for (const ifaddrs* each = all; each != nullptr; each = each->ifa_next) {
    if (path->interface != each->ifa_name) continue;
    const bool is_up = (each->ifa_flags & IFF_UP) != 0 && (each->ifa_flags & IFF_RUNNING) != 0;
    if (!is_up) {
      findings[0] = {"interface", Grade::kProblem, wire::describe(*path) + " is down",
                     "ip link set " + path->interface + " up, or another --listen"};
    }
    findings.push_back({"multicast", Grade::kOk,
                        std::string((each->ifa_flags & IFF_MULTICAST) != 0 ? "there" : "not there") +
                            "; none is needed: clients find the server by its address",
                        ""});
    break;
  }
  return findings;
}

Finding look_at_server(const AdminClientOptions& connection) {
  if (!connection.security.empty()) {
    if (auto finding = why_not_asked(connection.security, wall_clock_now())) return *std::move(finding);
  }
  auto client = AdminClient::connect(connection);
  if (!client)
    return {"server", Grade::kProblem, client.error().message,
            "start `cairn-server --store DIR` there, or name the host and network that it is on (--server, "
            "--domain, --profile)"};
  const auto status = client->ask({{"verb", "status"}});
  if (!status) return {"server", Grade::kProblem, status.error().message, "see to what it says"};
  const std::string health = text_of(status->content, "health");
  if (health != "ok")
    return {"server", Grade::kProblem, health, "`cairnctl status` and `cairnctl maps` say what to do"};
  return {"server", Grade::kOk, "answers, version " + text_of(status->content, "version"), ""};
}

Finding look_at_clock() {
  timex now{};
  const int state = ::adjtimex(&now);
  const bool is_synchronized = state != TIME_ERROR && (now.status & STA_UNSYNC) == 0;
  const std::string time = to_utc(wall_clock_now());
  if (is_synchronized) return {"clock", Grade::kOk, time + ", synchronized", ""};
  return {
      "clock", Grade::kWarning,
      time +
          ", not synchronized: grants and certificates expire by it, and audit entries are stamped with it",
      "timedatectl set-ntp true"};
}

Finding look_at_disk(const std::string& folder) {
  struct statvfs disk {};
  if (::statvfs(folder.c_str(), &disk) != 0)
    return {"disk", Grade::kProblem, one_line(folder) + ": is not there", "another --data, or make it"};
  return judge_disk(folder, uint64_t{disk.f_bavail} * disk.f_frsize, uint64_t{disk.f_blocks} * disk.f_frsize,
                    ::access(folder.c_str(), W_OK) == 0);
}

const char* word_of(Grade grade) {
  return grade == Grade::kOk ? "ok" : grade == Grade::kWarning ? "warning" : "problem";
}

Status tell(const std::vector<Finding>& findings, bool as_json) {
  json told = json::array();
  for (const Finding& finding : findings)
    told.push_back({{"what", finding.what},
                    {"grade", word_of(finding.grade)},
                    {"detail", finding.detail},
                    {"remedy", finding.remedy}});
  if (as_json) {
    std::printf("%s\n", json_text(told, 2).c_str());
  } else {
    for (const Finding& finding : findings) {
      std::printf("%-8s %-13s %s\n", word_of(finding.grade), finding.what.c_str(),
                  one_line(finding.detail).c_str());
      if (!finding.remedy.empty()) std::printf("%-8s %-13s remedy: %s\n", "", "", finding.remedy.c_str());
    }
  }
  const auto problems = std::ranges::count(findings, Grade::kProblem, &Finding::grade);
  if (problems == 0) return {};
  return fail(ErrorCode::kInternal, std::to_string(problems) + (problems == 1 ? " problem" : " problems"));
}

}  // namespace

Finding judge_ports(const std::string& range, const std::string& reserved, int domain) {
  const uint64_t first =
      wire::server_port(static_cast<uint32_t>(std::clamp<int>(domain, 0, wire::kMaxDomain)));
  const uint64_t last = std::min<uint64_t>(first + kPortsOfDomain, 65535);
  const std::string ours = "UDP " + std::to_string(first) + " to " + std::to_string(last);
  std::istringstream words(range);
  uint64_t begin = 0, end = 0;
  const bool is_known = static_cast<bool>(words >> begin >> end);
  if (!is_known || last < begin || first > end || is_reserved(reserved, first, last))
    return {"ports", Grade::kOk, ours + " of domain " + std::to_string(domain) + " are given to nobody else",
            ""};
  return {"ports", Grade::kWarning,
          ours + " are among those that the kernel gives to anybody (" + std::to_string(begin) + " to " +
              std::to_string(end) + "): a server may find its own taken",
          "sysctl net.ipv4.ip_local_reserved_ports=" + std::to_string(first) + "-" + std::to_string(last) +
              ", or another --domain"};
}

Finding judge_buffers(const std::string& most) {
  const auto bytes = number_in(most);
  if (!bytes) return {"buffers", Grade::kWarning, "net.core.rmem_max cannot be read", "see to /proc"};
  if (*bytes >= kWantedBuffer) return {"buffers", Grade::kOk, "net.core.rmem_max is " + most, ""};
  return {"buffers", Grade::kWarning,
          "net.core.rmem_max is " + most + " bytes: bursts of maps are lost and sent again",
          "sysctl net.core.rmem_max=" + std::to_string(kWantedBuffer)};
}

Finding judge_disk(const std::string& folder, uint64_t free_bytes, uint64_t all_bytes, bool is_writable) {
  const std::string detail = one_line(folder) + ": " + std::to_string(free_bytes / 1'000'000) + " of " +
                             std::to_string(all_bytes / 1'000'000) + " MB free";
  if (!is_writable)
    return {"disk", Grade::kProblem,
            one_line(folder) + ": cannot be written by " + std::to_string(::geteuid()),
            "see to owner and mount, or ask as the server's user"};
  const bool is_short =
      free_bytes < kFewBytes || static_cast<double>(free_bytes) < kFewShare * static_cast<double>(all_bytes);
  if (!is_short) return {"disk", Grade::kOk, detail, ""};
  return {"disk", free_bytes < kFewBytes / 10 ? Grade::kProblem : Grade::kWarning, detail,
          "free space there: `cairnctl maps purge`, old backups, files set aside in `damaged`"};
}

void describe_doctor(CLI::App* app, const AdminClientOptions* connection, LocalAction* local) {
  const auto words = std::make_shared<Words>();
  CLI::App* doctor = app->add_subcommand(
      "doctor",
      "what is in the way: interface, multicast, server, ports, socket buffers, clock, disk, certificates; "
      "and what to do");
  doctor->add_option("--data", words->data, "folder of a server's store, for its disk")->type_name("FOLDER");
  doctor
      ->add_option("--keys", words->keys,
                   "folder of a site's keys, or a server's security folder: whose certificate expires first")
      ->type_name("DIR");
  doctor->footer(kFooter);
  doctor->callback([=] {
    *local = [=](bool as_json) {
      std::vector<Finding> findings = look_at_network(*connection);
      if (!connection->security.empty()) {  // before the server, which is asked with these keys
        const auto own = look_at_security(connection->security, wall_clock_now());
        findings.insert(findings.end(), own.begin(), own.end());
      }
      findings.push_back(look_at_server(*connection));
      findings.push_back(judge_ports(content_of("/proc/sys/net/ipv4/ip_local_port_range"),
                                     content_of("/proc/sys/net/ipv4/ip_local_reserved_ports"),
                                     connection->domain));
      findings.push_back(judge_buffers(content_of("/proc/sys/net/core/rmem_max")));
      findings.push_back(look_at_clock());
      if (!words->data.empty()) findings.push_back(look_at_disk(words->data));
      if (!words->keys.empty()) findings.push_back(look_at_certificates(words->keys, wall_clock_now()));
      return tell(findings, as_json);
    };
  });
}

}  // namespace cairn
