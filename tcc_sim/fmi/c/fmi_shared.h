/* How both versions of FMI declare their functions, and those that mean the same in both. The file of a version includes this
   after its Instance and its answer(), with V(name), a name of that version, and STATE(before, after), that of a function on
   states. Instances and states are pointers to void in both. */
#ifdef _WIN32
#define TCC_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define TCC_EXPORT __attribute__((visibility("default")))
#else
#define TCC_EXPORT
#endif
#ifdef TCC_PREFIX
#define TCC_PASTE(a, b) a##b
#define TCC_NAME(prefix, name) TCC_PASTE(prefix, name)
#define F(name) TCC_NAME(TCC_PREFIX, name)
#else
#define F(name) name
#endif

#define FUNCTION(name, ...) TCC_EXPORT V(Status) F(name)(__VA_ARGS__); V(Status) F(name)(__VA_ARGS__)
#define OTHER(type, name, ...) TCC_EXPORT type F(name)(__VA_ARGS__); type F(name)(__VA_ARGS__)

static V(Status) unsupported(void *c, const char *what)
{
    return answer(c, tcc_say(&((Instance *)c)->plant, TCC_ERROR, "%s", what));
}

FUNCTION(V(SetDebugLogging), void *c, V(Boolean) on, size_t n, const V(String) categories[])
{
    (void)c; (void)on; (void)n; (void)categories;
    return V(OK);
}

OTHER(void, V(FreeInstance), void *c) { free(c); }
FUNCTION(V(ExitInitializationMode), void *c) { return answer(c, tcc_exit_initialization(&((Instance *)c)->plant)); }
FUNCTION(V(Terminate), void *c) { return answer(c, tcc_terminate(&((Instance *)c)->plant)); }
FUNCTION(STATE(Get,), void *c, void **s) { return answer(c, tcc_keep(&((Instance *)c)->plant, s)); }
FUNCTION(STATE(Set,), void *c, void *s) { return answer(c, tcc_restore(&((Instance *)c)->plant, s)); }

FUNCTION(STATE(Free,), void *c, void **s)
{
    (void)c;
    if (s) { free(*s); *s = NULL; }
    return V(OK);
}

FUNCTION(STATE(Serialized, Size), void *c, void *s, size_t *n)
{
    (void)c; (void)s;
    *n = sizeof(tcc_kept);
    return V(OK);
}

FUNCTION(STATE(Serialize,), void *c, void *s, V(Byte) bytes[], size_t n)
{
    return answer(c, tcc_serialise(&((Instance *)c)->plant, s, bytes, n));
}
