#include <flann/flann.hpp>
#include <bits/stdc++.h>
#include <time.h>
using D=std::array<uint64_t,4>; using namespace std;
static double cpu(){timespec t;clock_gettime(CLOCK_THREAD_CPUTIME_ID,&t);return t.tv_sec*1e3+t.tv_nsec*1e-6;}
__attribute__((target("popcnt"))) static inline int dist(const D&a,const D&b){return __builtin_popcountll(a[0]^b[0])+__builtin_popcountll(a[1]^b[1])+__builtin_popcountll(a[2]^b[2])+__builtin_popcountll(a[3]^b[3]);}
struct Ham{  typedef unsigned char ElementType; typedef unsigned int ResultType;
 template<class A,class B> __attribute__((target("popcnt"))) unsigned operator()(A a,B b,size_t,unsigned=-1)const{ const uint64_t*p=(const uint64_t*)a,*q=(const uint64_t*)b; return __builtin_popcountll(p[0]^q[0])+__builtin_popcountll(p[1]^q[1])+__builtin_popcountll(p[2]^q[2])+__builtin_popcountll(p[3]^q[3]);}
};
vector<D> kf,qs; vector<pair<D,D>> pairs;
mt19937_64 rng(7);
vector<D> sample(const vector<D>&v,size_t n){vector<D> o;vector<size_t> i(v.size());iota(i.begin(),i.end(),0);shuffle(i.begin(),i.end(),rng);for(size_t k=0;k<n&&k<v.size();k++)o.push_back(v[i[k]]);return o;}
int nearest(const vector<D>&w,const D&q){int b=0,bd=999;for(size_t i=0;i<w.size();i++){int d=dist(w[i],q);if(d<bd){bd=d;b=i;}}return b;}
D majority(const vector<const D*>&m){array<int,256> c{};for(auto*d:m)for(int i=0;i<256;i++)c[i]+=(*d)[i/64]>>(i%64)&1;D o{};for(int i=0;i<256;i++)if(2*c[i]>(int)m.size())o[i/64]|=1ull<<(i%64);return o;}
void lloyd(vector<D>&w,const vector<D>&v,int it,function<int(const D&)> (*mk)(const vector<D>&)){for(int t=0;t<it;t++){auto f=mk(w);vector<vector<const D*>> m(w.size());for(auto&d:v)m[f(d)].push_back(&d);for(size_t i=0;i<w.size();i++)if(m[i].size())w[i]=majority(m[i]);}}
struct Tree{ struct N{vector<D> c;vector<int> child;int word=-1;}; vector<N> n; int words=0;
 int build(vector<const D*> m,int br,int leaf,int depth){int id=n.size();n.emplace_back();if((int)m.size()<=leaf||depth==0){n[id].word=words++;return id;}
  vector<D> c;shuffle(m.begin(),m.end(),rng);set<D> seen;for(auto*d:m){if((int)c.size()==br)break;if(seen.insert(*d).second)c.push_back(*d);}
  vector<vector<const D*>> g;for(int it=0;it<5;it++){g.assign(c.size(),{});for(auto*d:m)g[nearest(c,*d)].push_back(d);if(it<4)for(size_t i=0;i<c.size();i++)if(g[i].size())c[i]=majority(g[i]);}
  vector<D> cc;vector<int> ch;for(size_t i=0;i<c.size();i++)if(g[i].size()){cc.push_back(c[i]);ch.push_back(g[i].size()==m.size()?build(g[i],br,1<<30,0):build(g[i],br,leaf,depth-1));}
  n[id].c=cc;n[id].child=ch;return id;}
 __attribute__((target("popcnt"))) int find(const D&q)const{int at=0;while(n[at].word<0){const N&x=n[at];int b=0,bd=999;for(size_t i=0;i<x.c.size();i++){int d=dist(x.c[i],q);if(d<bd){bd=d;b=i;}}at=x.child[b];}return n[at].word;}
};
void eval(const char*name,int words,function<int(const D&)> f,double build){
 double t=cpu();size_t s=0;for(size_t i=0;i<20000;i++)s+=f(qs[i*7%qs.size()]);t=(cpu()-t)/20000*1e3;
 vector<int> count(words);vector<int> kw;for(size_t i=0;i<kf.size();i+=3){count[f(kf[i])]++;kw.push_back(0);}
 double exp2=0;double n=kw.size();vector<int> qc(words);for(size_t i=0;i<qs.size();i+=11)qc[f(qs[i])]++;double nq=0;for(int x:qc)nq+=x;for(int i=0;i<words;i++)exp2+=count[i]/n*qc[i]/nq;
 size_t hit=0,tot=0;for(size_t i=0;i<pairs.size();i+=5){hit+=f(pairs[i].first)==f(pairs[i].second);tot++;}
 printf("%-44s words %6d build %7.0f ms lookup %6.2f us same word %.3f listshare %.6f (per kf of 2000: %.2f) ratio %.0f\n",name,words,build,t,hit*1.0/tot,exp2,exp2*2000,hit*1.0/tot/exp2);fflush(stdout);if(s==1)puts("");}
int main(){
 {FILE*f=fopen("kf.bin","rb");uint64_t h[9];while(fread(h,8,9,f)==9){size_t o=kf.size();kf.resize(o+h[8]);fread(&kf[o],32,h[8],f);}}
 {FILE*f=fopen("q.bin","rb");uint64_t n;while(fread(&n,8,1,f)==1)for(size_t i=0;i<n;i++){uint64_t l;D d;fread(&l,8,1,f);fread(&d,32,1,f);qs.push_back(d);}}
 {FILE*f=fopen("pairs.bin","rb");D a[2];while(fread(a,32,2,f)==2)pairs.push_back({a[0],a[1]});}
 printf("kf %zu q %zu pairs %zu\n",kf.size(),qs.size(),pairs.size());
 map<int,int> hist;for(auto&p:pairs)hist[dist(p.first,p.second)/10]++;for(auto&[k,v]:hist)printf("%d:%d ",k*10,v);puts("");

 vector<D> lv;{FILE*f=fopen("leaves.bin","rb");D d;while(fread(&d,32,1,f)==1)lv.push_back(d);}
 printf("leaves %zu\n",lv.size());
 for(int who:{0,1}){ auto&src=who?lv:kf; printf("trained on %s\n",who?"leaves":"own maps");
 for(int K:{256}){
  auto c=sample(src,K);for(int it=0;it<5;it++){vector<vector<const D*>> m(K);for(auto&d:src)m[nearest(c,d)].push_back(&d);for(int k=0;k<K;k++)if(m[k].size())c[k]=majority(m[k]);}
  vector<double> sz(K);for(auto&d:kf)sz[nearest(c,d)]+=1.0/kf.size();
  for(int n:{1,4,8,16}){double share=0;int nq=0;auto top=[&](const D&q){vector<pair<int,int>> v;for(int k=0;k<K;k++)v.push_back({dist(c[k],q),k});partial_sort(v.begin(),v.begin()+n,v.end());v.resize(n);return v;};
   for(size_t i=0;i<qs.size();i+=50){for(auto&[d,k]:top(qs[i]))share+=sz[k];nq++;}
   map<int,pair<int,int>> h;int hit=0,tot=0;for(size_t i=0;i<pairs.size();i+=5){int k=nearest(c,pairs[i].second);bool f=false;for(auto&[d,kk]:top(pairs[i].first))f|=kk==k;auto&x=h[dist(pairs[i].first,pairs[i].second)/10*10];x.second++;x.first+=f;hit+=f;tot++;}
   printf("cells %d probe %d: share %.4f recall %.3f by distance:",K,n,share/nq,hit*1./tot);for(auto&[k,x]:h)printf(" %d:%.2f",k,x.first*1./x.second);puts("");fflush(stdout);}
 }
 {vector<const D*> m;for(auto&d:src)m.push_back(&d);Tree t;double c=cpu();t.build(m,100,1,2);c=cpu()-c;eval("tree 100x100",t.words,[&](const D&d){return t.find(d);},c);}
 {vector<const D*> m;for(auto&d:src)m.push_back(&d);Tree t;double c=cpu();t.build(m,32,1,2);c=cpu()-c;eval("tree 32x32",t.words,[&](const D&d){return t.find(d);},c);}
 }
}
