// Vulkan for compute, its loader opened at run time: building takes headers only. Nothing is destroyed but what is
// large: the process ends soon.
#pragma once
#define VK_NO_PROTOTYPES
#include <vulkan/vulkan.h>

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>
#ifdef _WIN32
#define NOMINMAX
#include <windows.h>
#else
#include <dlfcn.h>
#endif

enum Code { DIFFERENT = 1, REFUSED = 2, NO_VULKAN = 77 };

struct Failure : std::runtime_error {
    Code code;
    Failure(Code code, const std::string& text) : std::runtime_error(text), code(code) {}
};

#define VULKAN_FUNCTIONS(each)                                                                                     \
    each(vkEnumeratePhysicalDevices) each(vkGetPhysicalDeviceProperties2) each(vkGetPhysicalDeviceFeatures2)       \
    each(vkGetPhysicalDeviceMemoryProperties) each(vkGetPhysicalDeviceQueueFamilyProperties)                       \
    each(vkEnumerateDeviceExtensionProperties) each(vkCreateDevice) each(vkGetDeviceProcAddr)                      \
    each(vkGetDeviceQueue) each(vkCreateCommandPool) each(vkAllocateCommandBuffers) each(vkBeginCommandBuffer)     \
    each(vkEndCommandBuffer) each(vkQueueSubmit) each(vkCreateFence) each(vkWaitForFences) each(vkResetFences)     \
    each(vkCreateBuffer) each(vkDestroyBuffer) each(vkGetBufferMemoryRequirements) each(vkAllocateMemory)          \
    each(vkFreeMemory) each(vkBindBufferMemory) each(vkMapMemory) each(vkCmdCopyBuffer) each(vkCmdPipelineBarrier) \
    each(vkCreateShaderModule) each(vkCreateDescriptorSetLayout) each(vkCreatePipelineLayout)                      \
    each(vkCreateComputePipelines) each(vkCreateDescriptorPool) each(vkAllocateDescriptorSets)                     \
    each(vkUpdateDescriptorSets) each(vkCmdBindPipeline) each(vkCmdBindDescriptorSets) each(vkCmdDispatch)         \
    each(vkCreateQueryPool) each(vkCmdResetQueryPool) each(vkCmdWriteTimestamp) each(vkGetQueryPoolResults)        \
    each(vkGetBufferDeviceAddress)

inline PFN_vkGetInstanceProcAddr vkGetInstanceProcAddr = nullptr;
#define DECLARE(name) inline PFN_##name name = nullptr;
VULKAN_FUNCTIONS(DECLARE)
#undef DECLARE

inline void check(VkResult result, const char* what) {
    if (result != VK_SUCCESS) throw Failure(REFUSED, std::string(what) + ": Vulkan's error " + std::to_string(result));
}

inline void open_loader() {
#ifdef _WIN32
    const char* file = "vulkan-1.dll";
    HMODULE library = LoadLibraryA(file);
    void* found = library ? reinterpret_cast<void*>(GetProcAddress(library, "vkGetInstanceProcAddr")) : nullptr;
#else
    const char* file = "libvulkan.so.1";
    void* library = dlopen(file, RTLD_NOW | RTLD_LOCAL);
    void* found = library ? dlsym(library, "vkGetInstanceProcAddr") : nullptr;
#endif
    if (!found) throw Failure(NO_VULKAN, std::string(file) + " is not here: install a GPU's driver or Vulkan's loader");
    vkGetInstanceProcAddr = reinterpret_cast<PFN_vkGetInstanceProcAddr>(found);
}

// All devices of all drivers.
inline std::vector<VkPhysicalDevice> devices(VkInstance& instance) {
    const char* remedy = "no device with Vulkan 1.1: install a GPU's driver, or Mesa's for the CPU";
    open_loader();
    const auto create = reinterpret_cast<PFN_vkCreateInstance>(vkGetInstanceProcAddr(nullptr, "vkCreateInstance"));
    VkApplicationInfo about = {VK_STRUCTURE_TYPE_APPLICATION_INFO, nullptr, "", 0, "", 0, VK_API_VERSION_1_2};
    VkInstanceCreateInfo info = {VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, nullptr, 0, &about, 0, nullptr, 0, nullptr};
    if (!create || create(&info, nullptr, &instance) != VK_SUCCESS) throw Failure(NO_VULKAN, remedy);
#define LOAD(name) name = reinterpret_cast<PFN_##name>(vkGetInstanceProcAddr(instance, #name));
    VULKAN_FUNCTIONS(LOAD)
#undef LOAD
    uint32_t count = 0;
    if (!vkGetPhysicalDeviceFeatures2 || vkEnumeratePhysicalDevices(instance, &count, nullptr) != VK_SUCCESS || !count)
        throw Failure(NO_VULKAN, remedy);
    std::vector<VkPhysicalDevice> found(count);
    check(vkEnumeratePhysicalDevices(instance, &count, found.data()), "vkEnumeratePhysicalDevices");
    return found;
}

struct Buffer {
    VkBuffer buffer = VK_NULL_HANDLE;
    VkDeviceMemory memory = VK_NULL_HANDLE;
    VkDeviceSize size = 0;
};

struct Device {
    VkPhysicalDevice physical = VK_NULL_HANDLE;
    VkDevice device = VK_NULL_HANDLE;
    VkQueue queue = VK_NULL_HANDLE;
    uint32_t family = 0, timestamp_bits = 0;
    bool addresses = false;  // of buffers
    VkCommandBuffer commands = VK_NULL_HANDLE;
    VkFence fence = VK_NULL_HANDLE;
    VkPhysicalDeviceProperties properties = {};

    // features: a chain of structures, as vkCreateDevice takes it.
    Device(VkPhysicalDevice physical, void* features, const std::vector<const char*>& extensions, bool addresses)
        : physical(physical), addresses(addresses) {
        VkPhysicalDeviceProperties2 about = {};
        about.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
        vkGetPhysicalDeviceProperties2(physical, &about);
        properties = about.properties;
        uint32_t count = 0;
        vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, nullptr);
        std::vector<VkQueueFamilyProperties> families(count);
        vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families.data());
        while (family < count && !(families[family].queueFlags & VK_QUEUE_COMPUTE_BIT)) ++family;
        if (family == count) throw Failure(REFUSED, "this device does not compute; give another --device");
        timestamp_bits = families[family].timestampValidBits;
        const float priority = 1.0f;
        VkDeviceQueueCreateInfo one = {
            VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, nullptr, 0, family, 1, &priority};
        VkDeviceCreateInfo info = {};
        info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
        info.pNext = features;
        info.queueCreateInfoCount = 1;
        info.pQueueCreateInfos = &one;
        info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
        info.ppEnabledExtensionNames = extensions.data();
        check(vkCreateDevice(physical, &info, nullptr, &device), "vkCreateDevice");
        vkGetDeviceQueue(device, family, 0, &queue);
        VkCommandPoolCreateInfo pool_info = {VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, nullptr,
                                             VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT, family};
        VkCommandPool pool;
        check(vkCreateCommandPool(device, &pool_info, nullptr, &pool), "vkCreateCommandPool");
        VkCommandBufferAllocateInfo commands_info = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, nullptr, pool,
                                                     VK_COMMAND_BUFFER_LEVEL_PRIMARY, 1};
        check(vkAllocateCommandBuffers(device, &commands_info, &commands), "vkAllocateCommandBuffers");
        VkFenceCreateInfo fence_info = {VK_STRUCTURE_TYPE_FENCE_CREATE_INFO, nullptr, 0};
        check(vkCreateFence(device, &fence_info, nullptr, &fence), "vkCreateFence");
    }

    // on_host: where the host reads and writes, else where the device is fastest.
    Buffer buffer(VkDeviceSize size, bool on_host) const {
        Buffer made;
        made.size = size;
        VkBufferCreateInfo info = {};
        info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
        info.size = size;
        info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
                     VK_BUFFER_USAGE_TRANSFER_DST_BIT;
        if (addresses) info.usage |= VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
        check(vkCreateBuffer(device, &info, nullptr, &made.buffer), "vkCreateBuffer");
        VkMemoryRequirements needs;
        vkGetBufferMemoryRequirements(device, made.buffer, &needs);
        const VkMemoryAllocateFlagsInfo flags = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO, nullptr,
                                                 VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT, 0};
        const VkMemoryAllocateInfo memory = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, addresses ? &flags : nullptr,
                                             needs.size, memory_type(needs.memoryTypeBits, on_host)};
        check(vkAllocateMemory(device, &memory, nullptr, &made.memory), "vkAllocateMemory");
        check(vkBindBufferMemory(device, made.buffer, made.memory, 0), "vkBindBufferMemory");
        return made;
    }

    uint32_t memory_type(uint32_t allowed, bool on_host) const {
        const VkMemoryPropertyFlags wanted = on_host
            ? VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT
            : VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
        VkPhysicalDeviceMemoryProperties all;
        vkGetPhysicalDeviceMemoryProperties(physical, &all);
        for (uint32_t i = 0; i < all.memoryTypeCount; ++i)
            if ((allowed >> i & 1) && (all.memoryTypes[i].propertyFlags & wanted) == wanted) return i;
        throw Failure(REFUSED, "this device has no memory for buffers; give another --device");
    }

    VkDeviceAddress address(const Buffer& of) const {
        const VkBufferDeviceAddressInfo info = {VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, nullptr, of.buffer};
        return vkGetBufferDeviceAddress(device, &info);
    }

    // What `record` records, after all that came before; returns when it is done.
    template <class Record> void run(Record record) const {
        const VkCommandBufferBeginInfo begin = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO, nullptr, 0, nullptr};
        check(vkBeginCommandBuffer(commands, &begin), "vkBeginCommandBuffer");
        const VkMemoryBarrier all = {VK_STRUCTURE_TYPE_MEMORY_BARRIER, nullptr, VK_ACCESS_MEMORY_WRITE_BIT,
                                     VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
        const VkPipelineStageFlags stages = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT;
        vkCmdPipelineBarrier(commands, stages, stages, 0, 1, &all, 0, nullptr, 0, nullptr);
        record(commands);
        const VkMemoryBarrier read = {VK_STRUCTURE_TYPE_MEMORY_BARRIER, nullptr, VK_ACCESS_MEMORY_WRITE_BIT,
                                      VK_ACCESS_HOST_READ_BIT};
        vkCmdPipelineBarrier(commands, stages, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &read, 0, nullptr, 0, nullptr);
        check(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
        VkSubmitInfo submit = {};
        submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
        submit.commandBufferCount = 1;
        submit.pCommandBuffers = &commands;
        check(vkQueueSubmit(queue, 1, &submit, fence), "vkQueueSubmit");
        check(vkWaitForFences(device, 1, &fence, VK_TRUE, UINT64_MAX), "vkWaitForFences");
        check(vkResetFences(device, 1, &fence), "vkResetFences");
    }

    Buffer uploaded(const void* data, size_t size) const {
        Buffer made = buffer(size, false);
        copied(made, [&](void* mapped) { std::memcpy(mapped, data, size); }, true);
        return made;
    }

    void download(const Buffer& from, void* data) const {
        copied(from, [&](void* mapped) { std::memcpy(data, mapped, from.size); }, false);
    }

    // By way of a buffer on the host, of which `use` reads or writes the bytes.
    template <class Use> void copied(const Buffer& other, Use use, bool upload) const {
        Buffer host = buffer(other.size, true);
        void* mapped = nullptr;
        check(vkMapMemory(device, host.memory, 0, other.size, 0, &mapped), "vkMapMemory");
        const VkBufferCopy all = {0, 0, other.size};
        if (upload) use(mapped);
        run([&](VkCommandBuffer to) {
            vkCmdCopyBuffer(to, upload ? host.buffer : other.buffer, upload ? other.buffer : host.buffer, 1, &all);
        });
        if (!upload) use(mapped);
        vkDestroyBuffer(device, host.buffer, nullptr);
        vkFreeMemory(device, host.memory, nullptr);
    }
};
