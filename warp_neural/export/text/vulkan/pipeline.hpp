// A compute pipeline of storage buffers, in set 0 from binding 0 on, and its time by timestamps.
#pragma once
#include <chrono>

#include "device.hpp"

struct Pipeline {
    const Device& on;
    VkPipelineLayout layout = VK_NULL_HANDLE;
    VkPipeline pipeline = VK_NULL_HANDLE;
    VkDescriptorSet set = VK_NULL_HANDLE;

    // constants: specialization constants, by their place.
    Pipeline(const Device& on, const std::vector<char>& code, const std::vector<uint32_t>& constants,
             const std::vector<Buffer>& buffers)
        : on(on) {
        const uint32_t count = static_cast<uint32_t>(buffers.size());
        std::vector<VkDescriptorSetLayoutBinding> bindings;
        for (uint32_t i = 0; i < count; ++i)
            bindings.push_back({i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
        const VkDescriptorSetLayoutCreateInfo set_info = {VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, nullptr,
                                                          0, count, bindings.data()};
        VkDescriptorSetLayout set_layout;
        check(vkCreateDescriptorSetLayout(on.device, &set_info, nullptr, &set_layout), "vkCreateDescriptorSetLayout");
        const VkPipelineLayoutCreateInfo layout_info = {
            VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO, nullptr, 0, 1, &set_layout, 0, nullptr};
        check(vkCreatePipelineLayout(on.device, &layout_info, nullptr, &layout), "vkCreatePipelineLayout");
        compile(code, constants);
        bind(set_layout, buffers);
    }

    void compile(const std::vector<char>& code, const std::vector<uint32_t>& constants) {
        std::vector<uint32_t> words(code.size() / 4);
        std::memcpy(words.data(), code.data(), 4 * words.size());
        const VkShaderModuleCreateInfo module_info = {VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, nullptr, 0,
                                                      4 * words.size(), words.data()};
        VkShaderModule module;
        check(vkCreateShaderModule(on.device, &module_info, nullptr, &module), "vkCreateShaderModule");
        std::vector<VkSpecializationMapEntry> entries;
        for (uint32_t i = 0; i < constants.size(); ++i) entries.push_back({i, 4 * i, 4});
        const VkSpecializationInfo special = {static_cast<uint32_t>(entries.size()), entries.data(),
                                              4 * constants.size(), constants.data()};
        VkComputePipelineCreateInfo info = {};
        info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
        info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
        info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
        info.stage.module = module;
        info.stage.pName = "main";
        info.stage.pSpecializationInfo = &special;
        info.layout = layout;
        check(vkCreateComputePipelines(on.device, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline),
              "vkCreateComputePipelines");
    }

    void bind(VkDescriptorSetLayout set_layout, const std::vector<Buffer>& buffers) {
        const uint32_t count = static_cast<uint32_t>(buffers.size());
        const VkDescriptorPoolSize size = {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, count};
        const VkDescriptorPoolCreateInfo pool_info = {
            VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, nullptr, 0, 1, 1, &size};
        VkDescriptorPool pool;
        check(vkCreateDescriptorPool(on.device, &pool_info, nullptr, &pool), "vkCreateDescriptorPool");
        const VkDescriptorSetAllocateInfo set_info = {VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO, nullptr, pool, 1,
                                                      &set_layout};
        check(vkAllocateDescriptorSets(on.device, &set_info, &set), "vkAllocateDescriptorSets");
        std::vector<VkDescriptorBufferInfo> infos;
        for (const Buffer& each : buffers) infos.push_back({each.buffer, 0, each.size});
        VkWriteDescriptorSet write = {};
        write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
        write.dstSet = set;
        write.descriptorCount = count;
        write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
        write.pBufferInfo = infos.data();
        for (uint32_t i = 0; i < count; ++i, ++write.pBufferInfo) {
            write.dstBinding = i;
            write.descriptorCount = 1;
            vkUpdateDescriptorSets(on.device, 1, &write, 0, nullptr);
        }
    }

    // Milliseconds of each run, of at least three; 0 where the device has no timestamps.
    std::vector<double> run(uint32_t groups) const {
        VkQueryPoolCreateInfo info = {};
        info.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO;
        info.queryType = VK_QUERY_TYPE_TIMESTAMP;
        info.queryCount = 2;
        VkQueryPool queries;
        check(vkCreateQueryPool(on.device, &info, nullptr, &queries), "vkCreateQueryPool");
        const bool timed = on.timestamp_bits > 0;
        const auto began = std::chrono::steady_clock::now();
        std::vector<double> times;
        while (times.size() < 3 || (times.size() < 51 && std::chrono::steady_clock::now() - began < half_a_second)) {
            on.run([&](VkCommandBuffer to) {
                vkCmdResetQueryPool(to, queries, 0, 2);
                vkCmdBindPipeline(to, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
                vkCmdBindDescriptorSets(to, VK_PIPELINE_BIND_POINT_COMPUTE, layout, 0, 1, &set, 0, nullptr);
                if (timed) vkCmdWriteTimestamp(to, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries, 0);
                vkCmdDispatch(to, groups, 1, 1);
                if (timed) vkCmdWriteTimestamp(to, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries, 1);
            });
            uint64_t ticks[2] = {};
            if (timed)
                check(vkGetQueryPoolResults(on.device, queries, 0, 2, sizeof(ticks), ticks, sizeof(ticks[0]),
                                            VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
                      "vkGetQueryPoolResults");
            const uint64_t mask = on.timestamp_bits < 64 ? (uint64_t(1) << on.timestamp_bits) - 1 : ~uint64_t(0);
            times.push_back(1e-6 * on.properties.limits.timestampPeriod * double((ticks[1] - ticks[0]) & mask));
        }
        std::sort(times.begin(), times.end());
        return times;
    }

    static constexpr std::chrono::milliseconds half_a_second{500};
};
