// The CUDA driver, opened when a program runs: nothing of CUDA is needed to build it, and only the driver to run it.
#pragma once
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <type_traits>

#ifdef _WIN32
#include <windows.h>
#else
#include <dlfcn.h>
#endif

namespace cuda {

using Pointer = unsigned long long;  // to memory of the device
using Context = void*;
using Module = void*;
using Function = void*;
using Stream = void*;
using Event = void*;

// No driver, no device, or none that the kernels were compiled for: nothing is wrong with the program.
struct Unavailable : std::runtime_error {
    using std::runtime_error::runtime_error;
};

class Driver {
  public:
    Driver() {
        init = load<int (*)(unsigned)>("cuInit");
        load_into(error_name, "cuGetErrorName");
        load_into(device_count, "cuDeviceGetCount");
        load_into(device_name, "cuDeviceGetName");
        load_into(device_attribute, "cuDeviceGetAttribute");
        load_into(retain, "cuDevicePrimaryCtxRetain");
        load_into(set_current, "cuCtxSetCurrent");
        load_into(synchronize, "cuCtxSynchronize");
        load_into(module_load, "cuModuleLoadData");
        load_into(module_function, "cuModuleGetFunction");
        load_into(function_attribute, "cuFuncSetAttribute");
        load_into(allocate, "cuMemAlloc_v2");
        load_into(release, "cuMemFree_v2");
        load_into(upload, "cuMemcpyHtoD_v2");
        load_into(download, "cuMemcpyDtoH_v2");
        load_into(launch, "cuLaunchKernel");
        load_into(event_create, "cuEventCreate");
        load_into(event_record, "cuEventRecord");
        load_into(event_time, "cuEventElapsedTime");
        if (const int error = init(0)) throw Unavailable("the CUDA driver does not start: " + name_of(error));
    }

    void check(int error, const std::string& what) const {
        if (error) throw std::runtime_error(what + ": " + name_of(error));
    }

    int attribute(int device, int which) const {
        int value = 0;
        check(device_attribute(&value, which, device), "the device's attributes");
        return value;
    }

    // 90 is compute capability 9.0.
    int arch(int device) const { return 10 * attribute(device, 75) + attribute(device, 76); }

    int processors(int device) const { return attribute(device, 16); }

    int (*init)(unsigned);
    int (*error_name)(int, const char**);
    int (*device_count)(int*);
    int (*device_name)(char*, int, int);
    int (*device_attribute)(int*, int, int);
    int (*retain)(Context*, int);
    int (*set_current)(Context);
    int (*synchronize)();
    int (*module_load)(Module*, const void*);
    int (*module_function)(Function*, Module, const char*);
    int (*function_attribute)(Function, int, int);
    int (*allocate)(Pointer*, size_t);
    int (*release)(Pointer);
    int (*upload)(Pointer, const void*, size_t);
    int (*download)(void*, Pointer, size_t);
    int (*launch)(Function, unsigned, unsigned, unsigned, unsigned, unsigned, unsigned, unsigned, Stream, void**, void**);
    int (*event_create)(Event*, unsigned);
    int (*event_record)(Event, Stream);
    int (*event_time)(float*, Event, Event);

  private:
    std::string name_of(int error) const {
        const char* name = nullptr;
        error_name(error, &name);
        return name ? name : "error " + std::to_string(error);
    }

    template <class F>
    F load(const char* name) {
#ifdef _WIN32
        static const HMODULE library = LoadLibraryA("nvcuda.dll");
        void* const found = library ? reinterpret_cast<void*>(GetProcAddress(library, name)) : nullptr;
        const char* const file = "nvcuda.dll";
#else
        static void* const library = dlopen("libcuda.so.1", RTLD_NOW);
        void* const found = library ? dlsym(library, name) : nullptr;
        const char* const file = "libcuda.so.1";
#endif
        if (!library) throw Unavailable(std::string("no CUDA driver: ") + file + " is not there; install NVIDIA's driver");
        if (!found) throw Unavailable(std::string(file) + " has no " + name + "; install a newer driver");
        return reinterpret_cast<F>(found);
    }

    template <class F>
    void load_into(F& function, const char* name) {
        function = load<F>(name);
    }
};

// Memory of the device, of values of T.
template <class T>
class Memory {
  public:
    Memory(const Driver& driver, size_t count) : driver(driver), count(count) {
        driver.check(driver.allocate(&pointer, count * sizeof(T)), std::to_string(count * sizeof(T)) + " bytes of memory");
    }
    Memory(const Driver& driver, const T* values, size_t count) : Memory(driver, count) {
        driver.check(driver.upload(pointer, values, count * sizeof(T)), "an upload");
    }
    Memory(const Memory&) = delete;
    Memory& operator=(const Memory&) = delete;
    ~Memory() { driver.release(pointer); }

    void download(T* values) const { driver.check(driver.download(values, pointer, count * sizeof(T)), "a download"); }

    const Driver& driver;
    const size_t count;
    Pointer pointer = 0;
};

}  // namespace cuda
