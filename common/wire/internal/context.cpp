// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/context.h"

#include <algorithm>
#include <initializer_list>
#include <optional>
#include <string_view>

#include "common/base/utc.h"
#include "common/wire/internal/configuration.h"
#include "common/wire/internal/port_holder.h"
#include "common/wire/internal/sertype.h"
#include "common/wire/network_path.h"

namespace cairn::wire::internal {
namespace {

/// The middleware allows a process one domain of each number. On the network the number is ExternalDomainId;
/// inside, each participant of ours has a number of its own, the first free one from that on and, behind the
/// last one, from 0 on: the documents of a secured site speak of these and know none above kMaxDomain.
constexpr uint32_t kMaxParticipants = kMaxDomain + 1;

/// At the moment when its keys expire the middleware takes our participant apart, under those who use it:
/// what is made of it then ends the process.
constexpr std::chrono::seconds kExpiryMargin{1};

constexpr std::chrono::minutes kUnfitInterval{1};  ///< a peer that sends rubbish cannot fill the disk

Result<std::pair<Entity, dds_domainid_t>> create_domain(uint32_t first, const std::string& configuration) {
  dds_entity_t created = DDS_RETCODE_PRECONDITION_NOT_MET;
  dds_domainid_t id = first;
  for (uint32_t i = 0; i < kMaxParticipants && created == DDS_RETCODE_PRECONDITION_NOT_MET; ++i) {
    id = (first + i) % kMaxParticipants;
    created = dds_create_domain(id, configuration.c_str());
  }
  if (created == DDS_RETCODE_PRECONDITION_NOT_MET)
    return fail(ErrorCode::kConfiguration, "this process has " + std::to_string(kMaxParticipants) +
                                               " DDS participants, the most that it may have");
  auto domain = checked(created, "DDS domain");
  if (!domain) return tl::unexpected(domain.error());
  return std::pair(*std::move(domain), id);
}

/// A participant with ports that others know: its program, what it is in words, and the first of its two UDP
/// ports.
struct Stand {
  const char* program;
  const char* who;
  uint16_t port;
};

/// Why one could not start, when that is because somebody else has one of its ports.
std::optional<Error> explain_taken_port(uint32_t domain, const Stand& stand) {
  for (const uint16_t port : {stand.port, static_cast<uint16_t>(stand.port + 1)}) {
    if (!port_is_taken(port)) continue;
    const std::string number = std::to_string(domain);
    const auto holder = find_port_holder(port);
    const std::string by =
        holder ? holder->program + " (process " + std::to_string(holder->process) + ")" : "";
    const std::string what =
        holder && holder->program == stand.program
            ? "domain " + number + " has a " + stand.who + " on this host already: " + by +
                  " holds UDP port " + std::to_string(port)
            : "UDP port " + std::to_string(port) + ", the " + stand.who + "'s in domain " + number +
                  ", is held by " +
                  (holder ? by + ", another program"
                          : "a program of another user (`sudo ss -lunp` names it)") +
                  "; DDS programs such as those of ROS 2 use these ports too, most of them in domain 0";
    return Error{ErrorCode::kRefused,
                 what + "; stop it or choose another --domain, for trackers and cairnctl as well"};
  }
  return std::nullopt;
}

Error explain(const ParticipantOptions& options, const NetworkPath& path, const Error& error) {
  const bool is_rig = options.role == Role::kRig;
  if (is_rig || options.role == Role::kServer) {
    const Stand stand = is_rig ? Stand{"cairn-rig", "rig", rig_port(options.domain)}
                               : Stand{"cairn-server", "server", server_port(options.domain)};
    if (auto taken = explain_taken_port(options.domain, stand)) return *std::move(taken);
  }
  return {ErrorCode::kConfiguration, error.message + " (domain " + std::to_string(options.domain) +
                                         ", profile '" + options.profile + "', " + describe(path) +
                                         "); the lines above say more"};
}

/// The keys of a secured site, which must be of one who may play that role; nothing on an open site.
Result<std::optional<Security>> keys_of(const ParticipantOptions& options) {
  if (options.security.empty()) return std::nullopt;
  auto security = read_security(options.security);
  if (!security) return tl::unexpected(security.error());
  const std::string& role = security->role;
  const auto is_any_of = [&](std::initializer_list<std::string_view> fitting) {
    return std::find(fitting.begin(), fitting.end(), role) != fitting.end();
  };
  const bool fits = options.role == Role::kServer         ? is_any_of({"server"})
                    : options.role == Role::kRig          ? is_any_of({"rig"})
                    : options.role == Role::kWearerCamera ? is_any_of({"client"})
                                                          : is_any_of({"client", "operator"});
  if (fits) return std::optional(*std::move(security));
  const char* needed = options.role == Role::kServer ? "a server"
                       : options.role == Role::kRig  ? "a rig"
                                                     : "a client";
  return fail(ErrorCode::kConfiguration, options.security + ": the keys are of " + role + " " +
                                             security->name + "; those of " + needed + " are needed here");
}

/// The first free one of a wearer's camera.
Result<uint16_t> find_place(const ParticipantOptions& options) {
  if (options.role != Role::kWearerCamera) return uint16_t{0};
  for (uint16_t place = 0; place < kMaxWearerCameras; ++place) {
    const uint16_t port = wearer_port(options.domain, place);
    if (!port_is_taken(port) && !port_is_taken(static_cast<uint16_t>(port + 1))) return place;
  }
  const uint16_t first = wearer_port(options.domain, 0);
  return fail(ErrorCode::kRefused, "all UDP ports for the cameras of wearers on this host are taken, " +
                                       std::to_string(first) + " to " +
                                       std::to_string(first + 2 * kMaxWearerCameras - 1) + " in domain " +
                                       std::to_string(options.domain));
}

}  // namespace

Result<std::shared_ptr<Context>> Context::create(const ParticipantOptions& options) {
  const auto security = keys_of(options);
  if (!security) return tl::unexpected(security.error());
  Result<NetworkPath> path = find_path(options);
  if (!path) return tl::unexpected(path.error());
  const auto place = find_place(options);
  if (!place) return tl::unexpected(place.error());
  const Result<std::string> configuration =
      make_configuration(options, *path, *place, *security ? &**security : nullptr);
  if (!configuration) return tl::unexpected(configuration.error());
  auto domain = create_domain(options.domain, *configuration);
  if (!domain) return tl::unexpected(explain(options, *path, domain.error()));
  const dds_entity_t participant = dds_create_participant(domain->second, nullptr, nullptr);
  if (participant < 0) {
    // The domain has the ports by now: whoever is said to hold them would be ourselves.
    return fail(ErrorCode::kConfiguration,
                std::string("DDS participant: ") + dds_strretcode(-participant) +
                    (options.security.empty() ? "" : ", with the keys of " + options.security) +
                    "; the lines above say more");
  }
  return std::shared_ptr<Context>(new Context(std::move(domain->first), participant, *std::move(path),
                                              *security, internal::writes_in_batches(options.role),
                                              options.log));
}

Status Context::check_keys() const {
  if (!security_ || wall_clock_now() < security_->expires + -kExpiryMargin) return {};
  return fail(ErrorCode::kConfiguration, security_->folder.string() + ": the keys have expired at " +
                                             to_utc(security_->expires) + "; `cairnctl keys renew " +
                                             security_->role + " " + security_->name + "` makes new ones");
}

Result<dds_entity_t> Context::topic(const TopicDescription& description) {
  const std::lock_guard lock(mutex_);
  if (Status good = check_keys(); !good) return tl::unexpected(good.error());
  if (const auto known = topics_.find(description.name); known != topics_.end()) return known->second;
  const dds_entity_t created =
      dds_create_topic(participant_, description.type, description.name, nullptr, nullptr);
  if (created < 0) {
    return fail(ErrorCode::kInternal,
                std::string("topic ") + description.name + ": " + dds_strretcode(-created));
  }
  topics_.emplace(description.name, created);
  return created;
}

Result<const ddsi_sertype*> Context::sertype(const char* topic, dds_entity_t writer) {
  const std::lock_guard lock(mutex_);
  if (const auto known = sertypes_.find(topic); known != sertypes_.end()) return known->second;
  if (Status good = check_keys(); !good) return tl::unexpected(good.error());
  const ddsi_sertype* type = cairn_wire_sertype(participant_, writer);
  if (type == nullptr)
    return fail(ErrorCode::kInternal,
                std::string("topic ") + topic + ": the middleware does not tell how it is serialized");
  sertypes_.emplace(topic, type);
  return type;
}

void Context::report_unfit(const char* topic, const std::string& partition, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  const auto [it, is_new] = unfit_.try_emplace(topic);
  Unfit& unfit = it->second;
  if (!is_new && now - unfit.logged_at < kUnfitInterval) {
    ++unfit.passed_over;
    return;
  }
  log_->warn(
      "a {} from partition '{}' is dropped: {}{}", topic, partition, reason,
      unfit.passed_over == 0 ? "" : " (" + std::to_string(unfit.passed_over) + " more since the last line)");
  unfit = {now, 0};
}

}  // namespace cairn::wire::internal
